"""Arms made in code, so that these tests need no file."""

import math

import pytest

from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface

PITCH = 0.051


def make_ring_arm(rings: int = 3, per_ring: int = 8) -> Arm:
    """A cylinder with rings of default patches whose edges nearly meet."""
    surface = Surface.cylinder(0.01 + 0.051 * rings, per_ring * PITCH / math.tau)
    patches = [
        PlacedPatch(
            patch=Patch.default(), node_id=1 + per_ring * i + j, link=0, s=0.03 + 0.051 * i, a=j * PITCH
        )
        for i in range(rings)
        for j in range(per_ring)
    ]
    return Arm("rings", [Link("forearm", surface)], patches)


@pytest.fixture(scope="session")
def ring_arm() -> Arm:
    return make_ring_arm()


@pytest.fixture(scope="session")
def pad_arm() -> Arm:
    link = Link("pad", Surface.plane(0.05, 0.05))
    return Arm("pad", [link], [PlacedPatch(patch=Patch.default(), node_id=1, link=0, s=0.025, a=0.0)])
