"""What an arm file says of the robot that carries the skin: frames, joints, where angles come from."""

from __future__ import annotations

from dataclasses import dataclass

from skinbus.arrays import Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSettings:
    """One joint: its position is fixed or comes from Python.

    Positions are rad of revolute and continuous joints, m of prismatic ones.
    """

    name: str
    """As in the URDF."""
    fixed: float | None = None
    sd: float = 0.0
    """Standard deviation of the position."""
    is_linear: bool | None = None
    """Whether its keys are those of a prismatic joint; None where no key shows it."""
    key: str = "joint"
    """Where the file says so, for messages."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkFrame:
    """Which link of the URDF an arm's link is a part of, and where its surface is there."""

    name: str
    X_LS: Floats
    """(4, 4) pose of the surface's frame in the frame of the URDF's link."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotSettings:
    """``[robot]`` and ``[[joint]]`` of an arm file."""

    file: str
    """The arm file, for messages."""
    urdf: str
    base: str | None = None
    """Link that is the base frame; None for the root of the URDF."""
    tool: str | None = None
    """Link that is the tool frame; None for the end of the URDF's only branch."""
    max_age_ns: int
    """Oldest joint position, at the time of the SYNC, with which base and tool frame are valid."""
    links: tuple[LinkFrame, ...]
    """(n_links,) of the arm."""
    joints: tuple[JointSettings, ...] = ()

    @property
    def fixed(self) -> dict[str, float]:
        """Positions of the joints that do not move (rad, m), by name."""
        return {joint.name: joint.fixed for joint in self.joints if joint.fixed is not None}
