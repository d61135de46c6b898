"""Joints that move in a scene: their positions over time, piecewise linear between keys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING
from typing import NamedTuple

import numpy as np

from skinbus.arrays import Floats
from skinbus.errors import Fault, FaultList
from skinbus.model import Arm
from skinbus.robot.chain import load_chain
from skinbus.sim.effect import parameter, settings


@settings
class JointPathTable:
    """[[joint]]: how a joint of the arm's robot moves; others stay at their fixed position, or at 0."""

    name: str
    path: tuple[tuple[float, float], ...] = parameter(
        MISSING, "s, deg", "position over time; of a prismatic joint s, mm", min_length=1
    )


class JointMotion(NamedTuple):
    """The positions of the joints of an arm's robot over scene time."""

    names: tuple[str, ...]
    free: tuple[str, ...]
    """Names of the joints that the arm file does not fix."""
    paths: list[Floats]
    """By joint: keys (n, 2) of t (s) and position (rad or m)."""

    def positions(self, t_s: float) -> Floats:
        """Return the positions at a scene time, (n_joints,) rad or m."""
        return np.array([np.interp(t_s, *path.T) for path in self.paths], np.float64)


def motion_of(
    tables: Sequence[tuple[str, JointPathTable]], arm: Arm, faults: FaultList
) -> JointMotion | None:
    """Return how the joints of an arm move, or None after adding faults.

    Raises:
        ConfigError: the URDF, or the arm file that goes with it, has faults.
    """
    if arm.robot is None:
        faults += [
            Fault(key, table.name, f"no such table: {arm.name} has no [robot]") for key, table in tables
        ]
        return None
    chain = load_chain(arm.robot)
    fixed = arm.robot.fixed
    paths: dict[str, Floats] = {}
    for key, table in tables:
        wanted = "a joint without a path" if table.name in paths else ""
        if table.name in fixed:
            wanted = "a joint that the arm file does not fix"
        elif table.name not in chain.names:
            wanted = f"a joint of the robot: {', '.join(chain.names)}"
        if wanted:
            faults.add(f"{key}.name", table.name, wanted)
            continue
        j = chain.names.index(table.name)
        scale = 1e-3 if chain.linear[j] else np.pi / 180.0
        path = paths[table.name] = np.array(table.path) * (1.0, scale)
        if (np.diff(path[:, 0]) <= 0.0).any():
            faults.add(f"{key}.path", [k[0] for k in table.path], "times that grow")
        beyond = [chain.are_beyond(np.full(chain.n_joints, position))[j] for position in path[:, 1]]
        if any(beyond):
            wanted = f"within the URDF's limits, {chain.lower[j] / scale:g} to {chain.upper[j] / scale:g}"
            faults.add(f"{key}.path", table.path[beyond.index(True)][1], wanted)
    every = [paths.get(name, np.array([[0.0, fixed.get(name, 0.0)]])) for name in chain.names]
    return JointMotion(chain.names, tuple(name for name in chain.names if name not in fixed), every)
