"""The joints that move the skin, compiled once from a URDF and an arm to flat arrays; their limits.

Joints that move neither a link with skin nor the tool are left out, fixed ones are merged into the frames
that they carry. All poses are in the base frame, which no joint may move. X_AB is the pose of B in A.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinbus.arrays import Bools, Floats, Ints
from skinbus.errors import ArgumentError, ConfigError, FaultList
from skinbus.model import Arm
from skinbus.model.robot import RobotSettings
from skinbus.robot.urdf import Joint, read_urdf

MAX_JOINTS = 16
"""Of the paths from the base to the skin and the tool: twice those of any arm; objects exist for so many."""
SLACK_RAD = 0.1
SLACK_M = 0.01
"""How far positions may be beyond limits: joints are calibrated to a degree or a millimetre, and go a little
beyond soft limits; degrees in place of radians, or mm in place of m, are far more."""


class Chain(NamedTuple):
    """Moving joints in the order of the tree, and the frames that they carry.

    Frames are numbered: the surfaces of the arm's links, then the URDF's links that they are on, the tool.

    names, kinds  (n_joints,) names and kinds as in the URDF
    parent        (n_joints,) joint that carries this one, -1 for the base
    linear        (n_joints,) whether it is prismatic
    X_PJ          (n_joints, 4, 4) frame at position 0 in that of the parent
    axis          (n_joints, 3) unit vectors in the joint's frame
    carrier       (n_frames,) joint that carries a frame, -1 for the base
    X_CF          (n_frames, 4, 4) frame in that of its carrier
    moves         (n_frames, n_joints) whether a joint moves a frame
    lower, upper  (n_joints,) limits as in the URDF; infinite where it has none
    velocity      (n_joints,) rad/s or m/s, the same
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    parent: Ints
    linear: Bools
    X_PJ: Floats
    axis: Floats
    carrier: Ints
    X_CF: Floats
    moves: Bools
    lower: Floats
    upper: Floats
    velocity: Floats

    @property
    def n_joints(self) -> int:
        """Number of moving joints."""
        return len(self.names)

    def are_beyond(self, positions: Floats) -> Bools:
        """Return which positions (n_joints,) are beyond limits; limits that leave no range are none."""
        slack = np.where(self.linear, SLACK_M, SLACK_RAD)
        is_limited = (np.array(self.kinds) != "continuous") & (self.lower < self.upper)
        beyond = (positions < self.lower - slack) | (positions > self.upper + slack)
        return np.asarray(is_limited & beyond)


def check_robot(arm: Arm) -> Arm:
    """Return an arm whose robot, if its file has one, can be used; errors are those of :func:`load_chain`."""
    if arm.robot:
        load_chain(arm.robot)
    return arm


def check_positions(chain: Chain, positions: Floats) -> None:
    """Check positions (n_joints,), rad or m, NaN of joints that are not meant: degrees are refused.

    Raises:
        ArgumentError: one is beyond the limits of its joint.
    """
    for j in np.flatnonzero(chain.are_beyond(positions)):
        unit, what = ("m", "metres, not mm") if chain.linear[j] else ("rad", "radians, not degrees")
        raise ArgumentError(
            f"joint {chain.names[j]!r} at {positions[j]:g} {unit}; wanted {chain.lower[j]:g} to "
            f"{chain.upper[j]:g} {unit}, as in the URDF: positions are in {what}"
        )


def load_chain(settings: RobotSettings) -> Chain:
    """Return the chain of an arm's robot.

    Raises:
        ConfigError: faults of the URDF; or the arm file names what it does not have, the skin is on a joint
            that is not supported, or a fixed position is beyond its limits: all such faults.
        SkinbusError: lxml is not installed.
    """
    root, joints = read_urdf(settings.urdf)
    faults = FaultList()
    carriers = {joint.child: joint for joint in joints}

    def path(link: str) -> list[Joint]:
        """Return the joints from the root to a link, the last one first."""
        found = []
        while link in carriers:
            found.append(carriers[link])
            link = carriers[link].parent
        return found

    base, tool = settings.base or root, settings.tool or _only_end(root, joints, faults)
    keyed = [(f"link[{i}].name or .frame", frame.name) for i, frame in enumerate(settings.links, 1)]
    known = [root, *carriers]
    for key, name in [("robot.base", settings.base), ("robot.tool", settings.tool), *keyed]:
        if name is not None and name not in known:
            faults.add(key, name, f"a link of the URDF: {', '.join(known)}")
    wanted = [name for name in (*(frame.name for frame in settings.links), tool) if name]
    used = {joint.name for name in wanted for joint in path(name)}
    moving = [joint.name for joint in path(base) if joint.kind != "fixed"]
    if moving:
        faults.add("robot.base", base, f"a link that no joint moves; {moving[-1]} moves this")
    moved = [joint for joint in joints if joint.name in used and joint.kind != "fixed"]
    for joint in moved:
        key = f"URDF <joint {joint.name}>"
        if joint.mimics is not None:
            wish = f"an independent joint: it mimics {joint.mimics}, which is not supported"
            faults.add(key, None, wish)
        if joint.kind in ("floating", "planar"):
            faults.add(key, joint.kind, "revolute, continuous, prismatic or fixed")
    if len(moved) > MAX_JOINTS:
        wish = f"at most {MAX_JOINTS} from the base to skin and tool"
        faults.add("robot.urdf", f"{len(moved)} joints", wish)
    kinds = {joint.name: joint.kind for joint in moved}
    every = {joint.name for joint in joints}
    for said in settings.joints:
        kind = kinds.get(said.name)
        if kind is None:
            why = "that moves skin or tool" if said.name in every else "of the URDF"
            faults.add(f"{said.key}.name", said.name, f"a joint {why}: {', '.join(kinds)}")
        elif said.is_linear is not None and said.is_linear != (kind == "prismatic"):
            keys = "keys in mm" if kind == "prismatic" else "keys in degrees"
            faults.add(said.key, said.name, f"{keys}: it is {kind}")
    if faults:
        raise ConfigError(settings.file, faults)
    chain = _compile(carriers, moved, base, wanted, settings)
    for said in settings.joints:
        j = chain.names.index(said.name)
        position = math.nan if said.fixed is None else said.fixed
        if chain.are_beyond(np.full(chain.n_joints, position))[j]:
            key, scale = ("fixed_mm", 1e-3) if chain.linear[j] else ("fixed_deg", math.radians(1.0))
            wish = f"{chain.lower[j] / scale:.6g} to {chain.upper[j] / scale:.6g}, as in the URDF"
            faults.add(f"{said.key}.{key}", round(position / scale, 6), wish)
    if faults:
        raise ConfigError(settings.file, faults)
    return chain


def _only_end(root: str, joints: list[Joint], faults: FaultList) -> str | None:
    """Return the link at the end of the one branch that moves; a fault where there are several."""
    depth = {root: 0}
    for joint in joints:
        depth[joint.child] = depth[joint.parent] + (joint.kind != "fixed")
    leaves = depth.keys() - {joint.parent for joint in joints}
    ends = [link for link in depth if link in leaves and depth[link] == max(depth.values())]
    if len(ends) == 1:
        return ends[0]
    faults.add("robot.tool", None, f"the link that is the tool frame, of {', '.join(ends)}")
    return None


def _compile(
    carriers: dict[str, Joint], moved: list[Joint], base: str, wanted: list[str], settings: RobotSettings
) -> Chain:
    number = {joint.child: j for j, joint in enumerate(moved)}

    def carried(link: str, X_BR: Floats) -> tuple[int, Floats]:
        """Return the joint that carries a link, and its pose there: in the base where there is none."""
        X_CL = np.eye(4)
        while link in carriers and link not in number:
            X_CL = carriers[link].X_PJ @ X_CL
            link = carriers[link].parent
        return number.get(link, -1), X_CL if link in number else X_BR @ X_CL

    X_BR = np.asarray(np.linalg.inv(carried(base, np.eye(4))[1]), np.float64)  # of the root in the base
    parents = [carried(joint.parent, X_BR) for joint in moved]
    links = [carried(link, X_BR) for link in wanted]
    frames = [(c, X @ frame.X_LS) for (c, X), frame in zip(links, settings.links, strict=False)] + links
    moves = np.zeros((len(frames), len(moved)), np.bool_)
    for f, (joint, _) in enumerate(frames):
        while joint >= 0:
            moves[f, joint] = True
            joint = parents[joint][0]
    return Chain(
        names=tuple(joint.name for joint in moved),
        kinds=tuple(joint.kind for joint in moved),
        parent=np.array([joint for joint, _ in parents], np.int64),
        linear=np.array([joint.kind == "prismatic" for joint in moved], np.bool_),
        X_PJ=np.array([X @ joint.X_PJ for (_, X), joint in zip(parents, moved, strict=True)]).reshape(
            -1, 4, 4
        ),
        axis=np.array([joint.axis for joint in moved]).reshape(-1, 3),
        carrier=np.array([joint for joint, _ in frames], np.int64),
        X_CF=np.array([X for _, X in frames]).reshape(-1, 4, 4),
        moves=moves,
        **{
            name: np.array([getattr(joint, name) for joint in moved])
            for name in ("lower", "upper", "velocity")
        },
    )
