"""Joints that move in a scene: their positions over time, and where a touch that is fixed in the base goes.

Positions are piecewise linear between keys. A touch in the base presses where the surface is nearest to its
point: the path of that place over the surface is computed ahead, and kept as keys like any path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, replace
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.errors import ConfigError, Fault
from skinbus.model import Arm
from skinbus.robot.chain import Chain, load_chain
from skinbus.robot.frames import RobotFrames
from skinbus.sim.effect import parameter, settings
from skinbus.sim.touch import Touch

Floats = npt.NDArray[np.float64]

KEY_S: Final = 2e-3
"""Between the keys of such a path: a surface that accelerates by 10 m/s^2 is 5 um off the line between."""
MOST_KEYS: Final = 100_000
"""Of such a path: 200 s of motion."""


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
        self.moved = tuple(paths)
        """Names of the joints that have a path."""
        self._frames = RobotFrames(arm, chain)
        fixed = {joint.name: joint.fixed or 0.0 for joint in arm.robot.joints}
        self._paths = [paths.get(name, np.array([[0.0, fixed.get(name, 0.0)]])) for name in chain.names]

    def positions(self, t_s: npt.ArrayLike) -> Floats:
        """Return the positions at scene times (...,), (..., n_joints) rad or m."""
        paths = [np.interp(np.asarray(t_s), path[:, 0], path[:, 1]) for path in self._paths]
        return np.stack(paths, -1) if paths else np.zeros((*np.shape(t_s), 0))

    def surface_pose(self, link: int, t_s: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Return rotations (..., 3, 3) and origins (..., 3) m of the surface of a link in the base."""
        X_BS = self._frames.surface_poses(self.positions(t_s))[..., link, :, :]
        return X_BS[..., :3, :3], X_BS[..., :3, 3]

    def in_base(self, touch: Touch) -> Touch:
        """Return a touch with the path of one that stays where it is in the base when it begins.

        Raises:
            ValueError: joints move too long while it presses.
        """
        surface = self._frames.arm.links[touch.link].surface
        R, p = self.surface_pose(touch.link, touch.start)
        point = R @ surface.position(*touch.path[0, 1:])[0] + p
        times = self._times(touch.start, touch.end)
        R, p = self.surface_pose(touch.link, times)
        here = ((point - p)[:, None] @ R)[:, 0]
        path = np.stack([times, *surface.project(here)[:2]], -1)
        if surface.period:
            path[:, 2] = np.unwrap(path[:, 2], period=surface.period)
        return replace(touch, path=path)

    def _times(self, start: float, end: float) -> Floats:
        """Return times from start to end: those of all keys, and close ones in between where joints move."""
        every = np.concatenate([[start, end], *(path[:, 0] for path in self._paths)])
        keys = np.unique(every[(every >= start) & (every <= end)])
        times = [keys[:1]]
        for begin, stop in pairwise(keys.tolist()):
            moves = not np.array_equal(self.positions(begin), self.positions(stop))
            times.append(
                np.linspace(begin, stop, 1 + (int(np.ceil((stop - begin) / KEY_S)) if moves else 1))[1:]
            )
        if sum(map(len, times)) > MOST_KEYS:
            raise ValueError(f"at most {MOST_KEYS * KEY_S:g} s of motion under a touch in the base")
        return np.concatenate(times)


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
        if table.name not in chain.names:
            faults.append(Fault(f"{key}.name", table.name, f"a joint of the robot: {', '.join(chain.names)}"))
            continue
        if table.name in paths:
            faults.append(Fault(f"{key}.name", table.name, "a joint without a path"))
        if table.name in fixed:
            faults.append(Fault(f"{key}.name", table.name, "a joint that the arm file does not fix"))
        path = np.array(table.path)
        if (np.diff(path[:, 0]) <= 0.0).any():
            faults.append(Fault(f"{key}.path", [k[0] for k in table.path], "times that grow"))
        j = chain.names.index(table.name)
        scale = 1e-3 if chain.linear[j] else np.pi / 180.0
        beyond = (scale * path[:, 1] < chain.lower[j] - 1e-9) | (scale * path[:, 1] > chain.upper[j] + 1e-9)
        if chain.kinds[j] != "continuous" and beyond.any():
            low, high = chain.lower[j] / scale, chain.upper[j] / scale
            wanted = f"within the URDF's limits, {low:g} to {high:g}"
            faults.append(Fault(f"{key}.path", float(path[beyond, 1][0]), wanted))
        paths[table.name] = path * (1.0, scale)
    return JointMotion(arm, chain, paths)
