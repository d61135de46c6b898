"""Arms on robots, random robots as URDF, and the oracle of kinematics."""

import importlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from skinbus.model import Arm, Link, LinkFrame, Patch, PlacedPatch, RobotSettings, Surface

URDF = Path(__file__).parent / "urdf"

SURFACES = (Surface.cylinder(0.4, 0.05), Surface.cone(0.3, 0.06, 0.04), Surface.plane(0.2, 0.1))


def pinocchio():
    """The oracle; CI installs it, elsewhere a test without it is skipped."""
    if os.environ.get("CI"):
        return importlib.import_module("pinocchio")
    return pytest.importorskip("pinocchio", reason="pip install pin")


def pose(rng):
    """A random pose, (4, 4)."""
    Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    X = np.eye(4)
    X[:3, :3] = Q * np.sign(np.linalg.det(Q))
    X[:3, 3] = rng.uniform(-0.3, 0.3, 3)
    return X


def arm_on(urdf, names, rng, *, base=None, tool=None, joints=()):
    """An arm with a surface on each of these links of a URDF, in random poses."""
    links = [Link(f"skin {i}", SURFACES[i % 3]) for i in range(len(names))]
    frames = tuple(LinkFrame(name=name, X_LS=pose(rng)) for name in names)
    patches = [
        PlacedPatch(patch=Patch.default(), node_id=i + 1, link=i, s=0.1, a=0.0) for i in range(len(names))
    ]
    settings = RobotSettings(
        file="arm.toml",
        urdf=str(urdf),
        base=base,
        tool=tool,
        max_age_ns=50_000_000,
        links=frames,
        joints=tuple(joints),
    )
    return Arm("on a robot", links, patches, robot=settings)


@dataclass
class Columns:
    """The columns of contacts that are placed."""

    link: np.ndarray
    s: np.ndarray
    a: np.ndarray
    force: np.ndarray
    covariance: np.ndarray


def columns_on(arm, rng, n=5):
    """Random contacts on the surfaces of an arm."""
    link = rng.integers(0, len(arm.links), n)
    root = rng.standard_normal((n, 3, 3)) * np.array([1e-3, 1e-3, 0.3])[:, None]
    return Columns(
        link=link,
        s=rng.uniform(0.01, 0.19, n),
        a=np.array([rng.uniform(-0.5, 0.5) * arm.links[k].surface.width for k in link]),
        force=rng.uniform(0.5, 20.0, n),
        covariance=root @ root.transpose(0, 2, 1),
    )


def random_urdf(rng, kinds=("revolute", "continuous", "prismatic", "fixed")):
    """The text of a tree of up to 12 joints, with links link0 ... in order; its last link is a leaf."""
    n = int(rng.integers(1, 13))
    lines = ['<robot name="random">', '<link name="link0"/>']
    for j in range(n):
        # mostly a chain, at times a branch
        parent = j if rng.random() < 0.8 else int(rng.integers(0, j + 1))
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        numbers = [
            " ".join(map(repr, map(float, v))) for v in (rng.uniform(-0.5, 0.5, 3), rng.uniform(-3, 3, 3))
        ]
        lines += [
            f'<link name="link{j + 1}"/>',
            f'<joint name="joint{j}" type="{rng.choice(kinds)}">',
            f'<parent link="link{parent}"/><child link="link{j + 1}"/>',
            f'<origin xyz="{numbers[0]}" rpy="{numbers[1]}"/>',
            f'<axis xyz="{" ".join(map(repr, map(float, axis)))}"/>',
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>',
        ]
    return "\n".join([*lines, "</robot>"]), n
