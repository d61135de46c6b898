"""One cycle as programs see it: contacts, readings and patches, the same from every source.

What a source does not carry is absent and says so: a covariance is None, a reading is not valid, an age is
infinite.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.can.clock import Clock
from skinbus.errors import ArgumentError, LocalProtocolError
from skinbus.estimate import LEVELS, Quality
from skinbus.estimate import Fault as Fault
from skinbus.estimate import TrackState as TrackState
from skinbus.master.level_control import CycleFlags as CycleFlags
from skinbus.master.patches.table import PatchState as PatchState
from skinbus.model import Arm
from skinbus.skin.layout import Layout as Layout
from skinbus.skin.on_robot import NO_ROBOT, Frame, OnRobot, Vector
from skinbus.skin.touch import Touch

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts

Floats = npt.NDArray[np.float64]

CONTACT: Final = np.dtype(
    [
        ("identity", "<i8"),
        ("seen_ns", "<i8"),
        ("id", "<u4"),
        ("link", "<u4"),
        ("state", "<u4"),
        ("quality", "<u4"),
        ("level", "<u4"),
        ("has_covariance", "<u4"),
        ("s", "<f8"),
        ("a", "<f8"),
        ("force", "<f8"),
        ("point", "<f8", 3),
        ("normal", "<f8", 3),
        ("covariance", "<f8", (3, 3)),
    ]
)
"""A contact as a record of 184 bytes: what shared memory holds, see ``docs/shared-memory.md``."""

_NUMBERS: Final = [name for name in CONTACT.names or () if CONTACT[name].shape == ()]
PATCH: Final = np.dtype([("last_fresh_ns", "<i8"), ("state", "<u4"), ("emcy", "<u4")])
"""The state of a patch as a record of 16 bytes."""

Records = npt.NDArray[Any]
"""(n,) of CONTACT or of PATCH."""


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """One contact of one cycle."""

    id: int
    """1..255, of no two contacts at a time."""
    identity: int
    """Counts from 1 and is never given twice; 0 where it is not known: from a bus."""
    state: TrackState
    """TOUCH first, then HELD or MOVE; COAST while it is not seen; LIFT once, when it has gone."""
    link: str
    s: float
    """Along the link, m."""
    a: float
    """Arc length around it, m."""
    point: Vector
    """(3,) m, in the frame of the link's surface, with a robot too; called it is in another frame:
    ``point("link")``, ``point("tool")``, and ``point()`` or ``point("base")``."""
    normal: Vector
    """(3,) outward unit normal, in the frame of the link's surface; called as ``point`` is."""
    force: float
    """Along the normal, N; tactels measure no shear."""
    covariance: Floats | None
    """(3, 3) of s, a (m) and force (N); None where it is not known: at level kmeans, and from a bus."""
    quality: Quality | None
    """Reasons why it may be wrong; None where it is not known: from a bus."""
    level: str | None
    """Level of the estimator that it comes from; None where it is not known: from a bus."""
    seen_ns: int
    """Time of the SYNC whose readings last showed it."""
    _now: Now = field(repr=False)
    _on_robot: OnRobot = field(repr=False)

    @property
    def age_s(self) -> float:
        """Age of the readings that last showed it, s."""
        return self._now.since(self.seen_ns)

    def force_vector(self, frame: Frame = "base") -> Floats:
        """Return the force on the skin in a frame, (3,) N: along the inward normal."""
        return -self.force * self._on_robot.normal(frame)

    def point_covariance(self, frame: Frame = "base") -> Floats | None:
        """Return the covariance of the point in frame "link", "base" or "tool", (3, 3) m^2.

        That of place on the surface and, but for "link", of the joint positions; None where it is not known.
        """
        covariance = self._on_robot.covariance(frame)
        return None if np.isnan(covariance).any() else covariance

    @property
    def jacobian(self) -> Floats:
        """(6, n_joints) of the point in the base: velocity, then angular velocity, by joint velocities."""
        return self._on_robot.jacobian()


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The readings of one cycle by tactel, of all patches in the order of ``patches``, or of one patch.

    That order is bus after bus as in the arm file; on each single patches, then those of rings in the
    order of their node-IDs. Tactels of a patch are in the order of its EDS.
    """

    pressures: Floats
    """(n_tactels,) Pa, less the zeros; 0 where they are not valid."""
    valid: npt.NDArray[np.bool_]
    """(n_tactels,) sampled in this cycle, by a tactel that is healthy and plausible."""
    faults: npt.NDArray[np.uint8]
    """(n_tactels,) bits of ``Fault``: why a tactel is not plausible; 0 for nothing."""

    def health(self, tactel: int) -> Fault:
        """Return what is wrong with a tactel; ``Fault(0)`` for nothing."""
        return Fault(int(self.faults[tactel]))


@dataclass(frozen=True, slots=True)
class Patch:
    """What is known of one patch."""

    node_id: int
    bus: str
    link: str
    state: PatchState
    emcy: int
    """Its last EMCY error code; 0 for none."""
    last_fresh_ns: int
    """When its last complete readings were in; 0 for never."""
    _now: Now = field(repr=False, compare=False)

    @property
    def age_s(self) -> float:
        """Age of its last readings, s; infinite when there were none."""
        return self._now.since(self.last_fresh_ns) if self.last_fresh_ns else math.inf


class Now:
    """The time that ages count from: that of a clock, or without one the time at which a cycle ended."""

    __slots__ = ("_clock", "_ended_ns")

    def __init__(self, clock: Clock | None, ended_ns: int) -> None:
        self._clock = clock
        self._ended_ns = ended_ns

    def since(self, t_ns: int) -> float:
        """Return the time since then, s."""
        return 1e-9 * ((self._clock.now_ns() if self._clock else self._ended_ns) - t_ns)


@dataclass(eq=False)
class Cycle:
    """One cycle; its parts are made when they are asked for, and stay as they are."""

    number: int
    """1, 2, 3, ... as the source made them; a gap shows cycles that were lost. 0: there was none yet."""
    t_ns: int
    """Time of its SYNC, on the clock of the source: on a live bus the machine's monotonic clock."""
    counter: int
    """Of the SYNC, 1..240."""
    level: str | None
    """The most accurate level that it used; None where a master on the bus does not say it."""
    flags: CycleFlags
    """What was not as it should be."""
    latency_s: float
    """From its SYNC until its contacts were out, s."""
    layout: Layout = field(repr=False)
    now: Now = field(repr=False)
    truth: tuple[Touch, ...] = ()
    """The touches of a simulation when its readings were sampled; empty elsewhere."""
    published: Records | None = None
    """What the master of a recording published then, of CONTACT, places rounded to 0.1 mm; None elsewhere."""
    bus_loads: tuple[float, ...] | None = None
    """Share of the last second that frames took on each bus; None where frames are not seen."""
    budget_us: float | None = None
    """Most time that the estimator had; infinite for no limit, None where it is not known."""

    @property
    def ended_ns(self) -> int:
        """When its contacts were out; 0 when there was no cycle yet."""
        return self.t_ns + round(1e9 * self.latency_s) if self.number else 0

    @property
    def age_s(self) -> float:
        """Age of its readings, s; infinite when there was no cycle yet."""
        return self.now.since(self.t_ns) if self.number else math.inf

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts; those that have gone are there once more, with state LIFT and no force."""
        records = self.records
        if not len(records):
            return ()
        columns = (records[_NUMBERS].tolist(), records["point"], records["normal"], records["covariance"])
        return tuple(self._contact(k, *parts) for k, parts in enumerate(zip(*columns, strict=True)))

    @cached_property
    def readings(self) -> Readings:
        """The readings; none is valid where the source does not carry them: from a bus."""
        n = self.layout.n_tactels
        return Readings(np.zeros(n), np.zeros(n, np.bool_), np.zeros(n, np.uint8))

    def readings_of(self, node_id: int, bus: str | None = None) -> Readings:
        """Return the readings of one patch, (n_tactels of the patch,); ``bus`` where node-IDs repeat.

        Raises:
            ArgumentError: there is no such patch, or there are several.
        """
        here, whole = self.layout.tactels_of(self.layout.patch_at(node_id, bus)), self.readings
        return Readings(whole.pressures[here], whole.valid[here], whole.faults[here])

    @cached_property
    def patches(self) -> tuple[Patch, ...]:
        """The patches: bus after bus as in the arm file; on each single patches, then those of rings."""
        layout, names = self.layout, self.layout.links
        columns = (layout.node_id, layout.patch_bus, layout.patch_link, self.patch_records)
        return tuple(
            Patch(
                node_id=int(node_id),
                bus=layout.buses[bus],
                link=names[link],
                state=PatchState(int(record["state"])),
                emcy=int(record["emcy"]),
                last_fresh_ns=int(record["last_fresh_ns"]),
                _now=self.now,
            )
            for node_id, bus, link, record in zip(*columns, strict=True)
        )

    @property
    def records(self) -> Records:
        """The contacts as records, (n_contacts,) of CONTACT."""
        return np.zeros(0, CONTACT)

    @property
    def patch_records(self) -> Records:
        """The patches as records, (n_patches,) of PATCH."""
        records = np.zeros(len(self.layout.node_id), PATCH)
        records["state"] = PatchState.ABSENT
        return records

    @property
    def robot(self) -> RobotContacts | None:
        """All that is known of the robot, as arrays; None where nothing is."""
        return None

    @property
    def robot_valid(self) -> bool:
        """Whether joint positions were young enough at the SYNC: else base and tool frame are NaN."""
        return self.robot is not None and self.robot.valid

    @property
    def joint_positions(self) -> Floats:
        """(n_joints,) rad or m at the SYNC, in the order of ``skin.joint_names``; NaN where not known."""
        return self.robot.positions if self.robot is not None else self._unknown()

    @property
    def joint_torques(self) -> Floats:
        """(n_joints,) N m (N of prismatic joints) by which all contacts act on the joints; or NaN."""
        return self.robot.torques if self.robot is not None else self._unknown()

    @property
    def joint_torque_covariance(self) -> Floats | None:
        """(n_joints, n_joints); None where it is not known."""
        robot = self.robot
        if robot is None or np.isnan(robot.torque_covariance).any():
            return None
        return robot.torque_covariance

    @property
    def base_wrench(self) -> Floats:
        """(6,) force (N) and moment (N m) of all contacts about the base, in the base frame; or NaN."""
        if self.robot is not None:
            return self.robot.base_wrench
        self._unknown()
        return np.full(6, np.nan)

    def link_wrench(self, link: str) -> Floats:
        """Return force (N) and moment (N m) of the contacts of a link, (6,); NaN where it is not known.

        They are about the origin of the URDF link that carries it, in that frame; ``link`` is the name in the
        arm file, as ``contact.link``. ArgumentError for another.
        """
        if link not in self.layout.links:
            raise ArgumentError(f"no link {link!r} in the arm file; it has {', '.join(self.layout.links)}")
        if self.robot is not None:
            return np.asarray(self.robot.link_wrench[self.layout.links.index(link)])
        self._unknown()
        return np.full(6, np.nan)

    def _unknown(self) -> Floats:
        """Return a NaN for each joint."""
        if self.layout.joints is None:
            raise LocalProtocolError(NO_ROBOT)
        return np.full(len(self.layout.joints), np.nan)

    def _robot_row(self, k: int) -> int:
        """Return the row of a contact in ``robot``, -1 where it is not there."""
        return -1

    def _contact(
        self, k: int, row: tuple[Any, ...], point: Floats, normal: Floats, covariance: Floats
    ) -> Contact:
        identity, seen_ns, number, link, state, quality, level, has_covariance, s, a, force = row
        is_known = level < len(LEVELS)
        X_LS = self.layout.X_LS
        on_robot = OnRobot(
            point,
            normal,
            X_LS[link] if X_LS is not None and link < len(X_LS) else None,
            self.layout.joints is not None,
            self.robot,
            self._robot_row(k),
        )
        return Contact(
            id=number,
            identity=identity,
            state=TrackState(state),
            link=link_name(self.layout.links, link),
            s=s,
            a=a,
            point=Vector.of(point, on_robot.point),
            normal=Vector.of(normal, on_robot.normal),
            force=force,
            covariance=covariance if has_covariance else None,
            quality=Quality(quality) if is_known else None,
            level=LEVELS[level] if is_known else None,
            seen_ns=seen_ns,
            _now=self.now,
            _on_robot=on_robot,
        )


UNKNOWN_LEVEL: Final = 255
"""Level of a record of which neither level nor quality is known."""


def link_name(links: Sequence[str], number: int) -> str:
    """Return the name of a link; one that the arm file does not have is a number."""
    return links[number] if number < len(links) else str(number)


def no_cycle(layout: Layout) -> Cycle:
    """Return what there is before the first cycle: no contact, no reading, no patch, of infinite age."""
    return Cycle(0, 0, 0, None, CycleFlags(0), math.inf, layout, Now(None, 0))


def fill_places(records: Records, arm: Arm) -> None:
    """Write point and normal of contacts, where s, a and link are written."""
    for number in np.unique(records["link"]).tolist():
        here = records["link"] == number
        if number < len(arm.links):
            surface = arm.links[number].surface
            records["point"][here], records["normal"][here] = surface.position(
                records["s"][here], records["a"][here]
            )
