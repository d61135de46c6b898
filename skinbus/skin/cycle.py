"""One cycle as programs see it: contacts, readings and patches, the same from every source.

What a source does not carry is absent and says so: a covariance is None, a reading is not valid, an age is
infinite.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skinbus.arrays import Bools, Bytes, Floats
from skinbus.errors import LocalProtocolError
from skinbus.estimate import TactelFault as TactelFault
from skinbus.estimate import TrackState as TrackState
from skinbus.master.level_control import CycleFlags as CycleFlags
from skinbus.master.patches.table import PatchState as PatchState
from skinbus.model import Arm
from skinbus.skin.contact import CONTACT as CONTACT
from skinbus.skin.contact import NO_ROBOT, Context, Records
from skinbus.skin.contact import Contact as Contact
from skinbus.skin.layout import SkinLayout as SkinLayout
from skinbus.skin.records import PATCH as PATCH

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """What a simulated finger really does in one cycle: the truth beside the contacts."""

    link: str
    s: float
    """Along the link, m."""
    a: float
    """Arc length around it, m."""
    point: Floats
    """(3,) m, in the frame of the link."""
    normal: Floats
    """(3,) outward unit normal, in the frame of the link."""
    force: float
    """Along the normal, N."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The readings of one cycle by tactel, of all patches in the order of ``patches``, or of one patch.

    That order is bus after bus as in the arm file; on each single patches, then those of rings in the
    order of their node-IDs. Tactels of a patch are in the order of its EDS.
    """

    pressures: Floats
    """(n_tactels,) Pa, less the zeros; 0 where they are not valid."""
    valid: Bools
    """(n_tactels,) sampled in this cycle, by a tactel that is healthy and plausible."""
    faults: Bytes
    """(n_tactels,) bits of ``TactelFault``: why a tactel is not plausible; 0 for nothing."""

    @classmethod
    def none(cls, n: int) -> Readings:
        """Return those of a source that carries none."""
        return cls(np.zeros(n), np.zeros(n, np.bool_), np.zeros(n, np.uint8))


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
    _context: Context = field(repr=False, compare=False)

    @property
    def age_s(self) -> float:
        """Age of its last readings, s; infinite when there were none."""
        return self._context.age_s(self.last_fresh_ns) if self.last_fresh_ns else math.inf


@dataclass(eq=False)
class Cycle:
    """One cycle; contacts and patches are made when they are asked for, and stay as they are."""

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
    context: Context = field(repr=False)
    records: Records = field(repr=False)
    """The contacts as records, (n_contacts,) of CONTACT."""
    patch_records: Records = field(repr=False)
    """The patches as records, (n_patches,) of PATCH."""
    readings: Readings = field(repr=False)
    """The readings; none is valid where the source does not carry them: from a bus."""
    truth: tuple[Touch, ...] = ()
    """The touches of a simulation when its readings were sampled; empty elsewhere."""
    budget_us: float | None = None
    """Most time that the estimator had; infinite for no limit, None where it is not known."""

    @property
    def layout(self) -> SkinLayout:
        """What of the arm does not change."""
        return self.context.layout

    @property
    def ended_ns(self) -> int:
        """When its contacts were out; 0 when there was no cycle yet."""
        return self.t_ns + round(1e9 * self.latency_s) if self.number else 0

    @property
    def age_s(self) -> float:
        """Age of its readings, s; infinite when there was no cycle yet."""
        return self.context.age_s(self.t_ns) if self.number else math.inf

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts; those that have gone are there once more, with state LIFT and no force."""
        return tuple(Contact.of(record, k, self.context) for k, record in enumerate(self.records))

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
        layout = self.layout
        columns = (layout.node_id, layout.patch_bus, layout.patch_link, self.patch_records)
        return tuple(
            Patch(
                int(node_id),
                layout.buses[bus],
                layout.links[link],
                PatchState(int(record["state"])),
                int(record["emcy"]),
                int(record["last_fresh_ns"]),
                self.context,
            )
            for node_id, bus, link, record in zip(*columns, strict=True)
        )

    @property
    def robot(self) -> RobotContacts | None:
        """All that is known of the robot, as wrenches and covariances of torques; None where nothing is."""
        return self.context.placed.robot if self.context.placed else None

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

    def _unknown(self) -> Floats:
        """Return a NaN for each joint."""
        if self.layout.joints is None:
            raise LocalProtocolError(NO_ROBOT)
        return np.full(len(self.layout.joints), np.nan)


def no_cycle(layout: SkinLayout) -> Cycle:
    """Return what there is before the first cycle: no contact, no reading, no patch, of infinite age."""
    patches = np.zeros(len(layout.node_id), PATCH)
    patches["state"] = PatchState.ABSENT
    return Cycle(
        0,
        0,
        0,
        None,
        CycleFlags(0),
        math.inf,
        Context(layout, lambda: 0),
        np.zeros(0, CONTACT),
        patches,
        Readings.none(layout.n_tactels),
    )


def fill_places(records: Records, arm: Arm) -> None:
    """Write point and normal of contacts, where s, a and link are written."""
    records["point"] = records["normal"] = np.nan  # where a listener's arm file is not the master's
    for k, link in enumerate(arm.links):
        here = records["link"] == k
        if here.any():
            places = records["s"][here], records["a"][here]
            records["point"][here], records["normal"][here] = link.surface.position(*places)
