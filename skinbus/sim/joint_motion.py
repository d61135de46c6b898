"""Joints that move in a scene: their positions over time, piecewise linear between keys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING

import numpy as np

from skinbus.arrays import Floats
from skinbus.errors import ConfigError, Fault
from skinbus.model import Arm
from skinbus.robot.chain import Chain, load_chain
from skinbus.sim.effect import parameter, settings


@settings
class JointPathTable:
    """[[joint]]: how a joint of the arm's robot moves; others stay at their fixed position, or at 0."""

    name: str
    path: tuple[tuple[float, float], ...] = parameter(
        MISSING, "s, deg", "position over time; of a prismatic joint s, mm", min_length=1
    )


class JointMotion:
    """The positions of the joints of an arm's robot over scene time."""

    def __init__(self, arm: Arm, chain: Chain, paths: dict[str, Floats]) -> None:
        """``paths``: keys (n, 2) of t (s) and position (rad or m) by joint."""
        if arm.robot is None:
            raise ValueError(f"{arm.name} has no robot")
        self.names = chain.names
        fixed = {joint.name: joint.fixed for joint in arm.robot.joints if joint.fixed is not None}
        self.free = tuple(name for name in chain.names if name not in fixed)
        """Names of the joints that the arm file does not fix."""
        self._paths = [paths.get(name, np.array([[0.0, fixed.get(name, 0.0)]])) for name in chain.names]

    def positions(self, t_s: float) -> Floats:
        """Return the positions at a scene time, (n_joints,) rad or m."""
        return np.array([np.interp(t_s, *path.T) for path in self._paths], np.float64)


def motion_of(
    tables: Sequence[tuple[str, JointPathTable]], arm: Arm, faults: list[Fault]
) -> JointMotion | None:
    """Return how the joints of an arm move, or None after adding faults."""
    if arm.robot is None:
        faults += [
            Fault(key, table.name, f"no such table: {arm.name} has no [robot]") for key, table in tables
        ]
        return None
    try:
        chain = load_chain(arm.robot)
    except ConfigError as error:
        faults += [Fault(f"scene.arm ({error.file}) {f.key}", f.seen, f.wanted) for f in error.faults]
        return None
    fixed = {joint.name for joint in arm.robot.joints if joint.fixed is not None}
    paths: dict[str, Floats] = {}
    for key, table in tables:
        wanted = None
        if table.name not in chain.names:
            wanted = f"a joint of the robot: {', '.join(chain.names)}"
        elif table.name in fixed:
            wanted = "a joint that the arm file does not fix"
        elif table.name in paths:
            wanted = "a joint without a path"
        if wanted is not None:
            faults.append(Fault(f"{key}.name", table.name, wanted))
            continue
        path, j = np.array(table.path), chain.names.index(table.name)
        if (np.diff(path[:, 0]) <= 0.0).any():
            faults.append(Fault(f"{key}.path", [k[0] for k in table.path], "times that grow"))
        scale = 1e-3 if chain.linear[j] else np.pi / 180.0
        paths[table.name] = path * (1.0, scale)
        only = np.where(np.arange(chain.n_joints) == j, paths[table.name][:, 1:], np.nan)
        if (beyond := chain.are_beyond(only)[:, j]).any():
            low, high = chain.lower[j] / scale, chain.upper[j] / scale
            wanted = f"within the URDF's limits, {low:g} to {high:g}"
            faults.append(Fault(f"{key}.path", float(path[beyond, 1][0]), wanted))
    return JointMotion(arm, chain, paths)
