"""The joints that move the skin, compiled once from a URDF and an arm to flat arrays.

Joints that move neither a link with skin nor the tool are left out, fixed ones are merged into the frames
that they carry. All poses are in the base frame, which no joint may move.

A monogram X_AB is the pose of B in A, R_AB its rotation, p_AB its origin (m).
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.errors import ConfigError, Fault
from skinbus.model import Arm
from skinbus.model.robot import JointSettings, RobotSettings
from skinbus.robot.urdf import Joint, names_in, read_urdf

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MAX_JOINTS: Final = 16
"""Of the paths from the base to the skin and the tool: twice those of any arm; objects exist for so many."""


class Chain(NamedTuple):
    """Moving joints in the order of the tree, and the frames that they carry.

    Frames are numbered: the surfaces of the arm's links, then the URDF's links that they are on, the tool.

    names, kinds  (n_joints,) names and kinds as in the URDF
    parent        (n_joints,) joint that carries this one, -1 for the base
    linear        (n_joints,) 1 for prismatic joints, else 0
    R_PJ, p_PJ    (n_joints, 3, 3), (n_joints, 3) m: frame at position 0 in that of the parent
    axis          (n_joints, 3) unit vectors in the joint's frame
    carrier       (n_frames,) joint that carries a frame, -1 for the base
    R_CF, p_CF    (n_frames, 3, 3), (n_frames, 3) m: frame in that of its carrier
    moves         (n_frames, n_joints) 1 where a joint moves a frame
    lower, upper  (n_joints,) limits as in the URDF; infinite where it has none
    velocity      (n_joints,) rad/s or m/s, the same
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    parent: Ints
    linear: Ints
    R_PJ: Floats
    p_PJ: Floats
    axis: Floats
    carrier: Ints
    R_CF: Floats
    p_CF: Floats
    moves: Ints
    lower: Floats
    upper: Floats
    velocity: Floats

    @property
    def n_joints(self) -> int:
        """Number of moving joints."""
        return len(self.names)

    def find(self, name: str) -> int:
        """Return the number of a joint; ValueError if it is none of these."""
        return self.names.index(name)


def load_chain(arm: Arm) -> Chain:
    """Return the chain of an arm with a robot.

    Raises:
        ConfigError: faults of the URDF, or of the arm file that goes with it: of both as the arm file's.
        SkinbusError: yourdfpy is not installed.
    """
    if arm.robot is None:
        raise ValueError(f"{arm.name} has no [robot]")
    return read_chain(arm.robot)


def read_chain(settings: RobotSettings) -> Chain:
    """Return the chain of an arm's robot, errors as those of :func:`load_chain`."""
    try:
        root, joints = read_urdf(settings.urdf)
    except ConfigError as error:
        links, names = names_in(settings.urdf)
        faults = _unknown_links(settings, links)
        for joint in settings.joints:
            if joint.name not in names:
                wish = f"a joint of the URDF: {', '.join(names)}"
                faults.append(Fault(f"{joint.key}.name", joint.name, wish))
        if not faults:
            raise
        raise ConfigError(settings.file, [*error.under_its_name(), *faults]) from None
    return compile_chain(root, joints, settings)


def compile_chain(root: str, joints: list[Joint], settings: RobotSettings) -> Chain:
    """Return the chain of the joints of a URDF (parents first) for an arm.

    Raises:
        ConfigError: the arm file names what the URDF does not have, or the skin is on a joint that is not
            supported: all such faults.
    """
    faults: list[Fault] = []
    carriers = {joint.child: joint for joint in joints}
    known = [root, *carriers]
    tool = settings.tool or _only_end(root, joints, faults)
    base = settings.base or root
    faults += _unknown_links(settings, known)
    wanted = [name for name in (*(frame.name for frame in settings.links), tool) if name in known]
    used = {joint.name for name in wanted for joint in _path(name, carriers)}
    if base in carriers:
        moving = [joint.name for joint in _path(base, carriers) if joint.kind != "fixed"]
        if moving:
            faults.append(Fault("robot.base", base, f"a link that no joint moves; {moving[-1]} moves this"))
    moved = [joint for joint in joints if joint.name in used and joint.kind != "fixed"]
    for joint in moved:
        if joint.mimics is not None:
            wish = f"an independent joint: it mimics {joint.mimics}, which is not supported"
            faults.append(Fault(f"URDF <joint {joint.name}>", None, wish))
        if joint.kind in ("floating", "planar"):
            faults.append(
                Fault(f"URDF <joint {joint.name}>", joint.kind, "revolute, continuous, prismatic or fixed")
            )
    if len(moved) > MAX_JOINTS:
        wish = f"at most {MAX_JOINTS} from the base to skin and tool"
        faults.append(Fault("robot.urdf", f"{len(moved)} joints", wish))
    _check_joints(settings.joints, moved, joints, faults)
    if faults:
        raise ConfigError(settings.file, faults)
    return _compile(carriers, moved, base, wanted, settings)


def _unknown_links(settings: RobotSettings, known: list[str]) -> list[Fault]:
    """Return the links that an arm file names and its URDF does not have."""
    keyed = [(f"link[{i}].name or .frame", frame.name) for i, frame in enumerate(settings.links, 1)]
    wish = f"a link of the URDF: {', '.join(known)}"
    return [
        Fault(key, name, wish)
        for key, name in [("robot.base", settings.base), ("robot.tool", settings.tool), *keyed]
        if name is not None and name not in known
    ]


def _compile(
    carriers: dict[str, Joint], moved: list[Joint], base: str, wanted: list[str], settings: RobotSettings
) -> Chain:
    number = {joint.child: j for j, joint in enumerate(moved)}

    def carried(link: str) -> tuple[int, Floats]:
        """Return the joint that carries a link, and its pose there: in the base where there is none."""
        X_CL = np.eye(4)
        while link in carriers and link not in number:
            X_CL = carriers[link].X_PJ @ X_CL
            link = carriers[link].parent
        return number.get(link, -1), X_CL if link in number else X_BR @ X_CL

    X_BR: npt.NDArray[Any] = np.eye(4)  # of the root in the base
    X_BR = np.linalg.inv(carried(base)[1])
    parent, X_PJ = [], []
    for joint in moved:
        carrier, X_CL = carried(joint.parent)
        parent.append(carrier)
        X_PJ.append(X_CL @ joint.X_PJ)
    frames = [carried(link) for link in wanted]
    surfaces = [(c, X @ frame.X_LS) for (c, X), frame in zip(frames, settings.links, strict=False)]
    frames = [*surfaces, *frames]
    moves = np.zeros((len(frames), len(moved)), np.int64)
    for f, (joint_number, _) in enumerate(frames):
        while joint_number >= 0:
            moves[f, joint_number] = 1
            joint_number = parent[joint_number]
    poses = np.array([X for _, X in frames]).reshape(-1, 4, 4)
    joint_poses = np.array(X_PJ).reshape(-1, 4, 4)
    return Chain(
        names=tuple(joint.name for joint in moved),
        kinds=tuple(joint.kind for joint in moved),
        parent=np.array(parent, np.int64),
        linear=np.array([joint.kind == "prismatic" for joint in moved], np.int64),
        R_PJ=np.ascontiguousarray(joint_poses[:, :3, :3]),
        p_PJ=np.ascontiguousarray(joint_poses[:, :3, 3]),
        axis=np.array([joint.axis for joint in moved]).reshape(-1, 3),
        carrier=np.array([c for c, _ in frames], np.int64),
        R_CF=np.ascontiguousarray(poses[:, :3, :3]),
        p_CF=np.ascontiguousarray(poses[:, :3, 3]),
        moves=moves,
        lower=np.array([joint.lower for joint in moved], float),
        upper=np.array([joint.upper for joint in moved], float),
        velocity=np.abs(np.array([joint.velocity for joint in moved], float)),
    )


def _path(link: str, carriers: dict[str, Joint]) -> list[Joint]:
    """Return the joints from the root to a link, the last one first."""
    path = []
    while link in carriers:
        path.append(carriers[link])
        link = carriers[link].parent
    return path


def _only_end(root: str, joints: list[Joint], faults: list[Fault]) -> str | None:
    """Return the link at the end of the one branch that moves; a fault where there are several."""
    parents = {joint.parent for joint in joints}
    carriers = {joint.child: joint for joint in joints}
    depth = {
        link: sum(joint.kind != "fixed" for joint in _path(link, carriers))
        for link in [root, *carriers]
        if link not in parents
    }
    ends = [link for link, n in depth.items() if n == max(depth.values())]
    if len(ends) == 1:
        return ends[0]
    faults.append(Fault("robot.tool", None, f"the link that is the tool frame, of {', '.join(ends)}"))
    return None


def _check_joints(
    settings: tuple[JointSettings, ...], moved: list[Joint], joints: list[Joint], faults: list[Fault]
) -> None:
    kinds = {joint.name: joint.kind for joint in moved}
    every = {joint.name for joint in joints}
    for joint in settings:
        kind = kinds.get(joint.name)
        if kind is None:
            why = "that moves skin or tool" if joint.name in every else "of the URDF"
            faults.append(Fault(f"{joint.key}.name", joint.name, f"a joint {why}: {', '.join(kinds)}"))
        elif joint.is_linear is not None and joint.is_linear != (kind == "prismatic"):
            keys = "keys in mm" if kind == "prismatic" else "counts_per_turn and keys in degrees"
            faults.append(Fault(joint.key, joint.name, f"{keys}: it is {kind}"))
