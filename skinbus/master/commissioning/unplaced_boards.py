"""Boards whose places are not known: the nodes of a bus as an arm of which only pressures are read."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.can.core import Step
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.config.placement import Mounting
from skinbus.config.system import ods_of
from skinbus.master.commissioning.identification import Identified, Place
from skinbus.master.commissioning.press_dialogue import Board
from skinbus.master.commissioning.scan import Found
from skinbus.master.cycle import CycleReport
from skinbus.master.master import Master
from skinbus.master.patches.provisioning import expected_node
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface
from skinbus.objects.board import describe_patch
from skinbus.objects.published import usual

Kind = tuple[int, ...]
Floats = npt.NDArray[np.float64]

UNSAID = (EventKind.TACTELS_IMPLAUSIBLE, EventKind.TACTELS_IMPLAUSIBLE_END)

GRID = 12
"""Boards in a row of the plane that stands for places not known: 12 x 11 for 126."""
APART = 0.2
"""m: no board is near another."""


class BoardKind(NamedTuple):
    """A kind of boards: what the arm file has of it."""

    kind: Kind
    """Device type, vendor and product; all boards of an arm that have them alike are of one kind."""
    patch: Patch
    """Not mirrored, whatever the arm file says of its place."""
    eds: str


def kinds_of(arm: Arm) -> list[BoardKind]:
    """Return the kind of every patch of an arm."""
    kinds = []
    for placed, od in zip(arm.patches, ods_of(arm), strict=True):
        identity = expected_node(placed.node_id, od).identity
        kind = (identity.device_type, identity.vendor, identity.product)
        kinds.append(BoardKind(kind, describe_patch(od, placed.eds), placed.eds))
    return kinds


class Unplaced(NamedTuple):
    """The boards on a bus that fit an arm, and the arm that they make."""

    boards: list[Board]
    arm: Arm
    strangers: list[int]
    """Node-IDs of nodes that fit none of its kinds."""


def unplaced(nodes: Iterable[Found], arm: Arm) -> Unplaced | None:
    """Return the boards among the nodes of a bus that are of the kinds of an arm; None if there is none."""
    kinds = kinds_of(arm)
    boards: list[Board] = []
    patches: list[PlacedPatch] = []
    strangers: list[int] = []
    for node in sorted(nodes, key=lambda node: node.node_id):
        numbers = node.numbers
        own = next((kind for kind in kinds if _fits(kind.kind, numbers)), None)
        if own is None:
            strangers.append(node.node_id)
            continue
        names = ("vendor", "product", "revision", "serial")
        identity = tuple(numbers.get(name) or 0 for name in names)
        patch = own.patch
        boards.append(Board(node.node_id, own.kind, patch.tactels_uv, patch.threshold, identity))
        row, column = divmod(len(patches), GRID)
        s, a = APART * (column + 1), APART * (row - 0.5 * GRID)
        patches.append(PlacedPatch(patch=patch, node_id=node.node_id, link=0, s=s, a=a, eds=own.eds))
    if not boards:
        return None
    plane = Link("not placed", Surface.plane(APART * (GRID + 1), APART * (GRID + 1)))
    return Unplaced(boards, Arm(arm.name, [plane], patches, arm.bus), strangers)


def _fits(kind: Kind, numbers: dict[str, int | None]) -> bool:
    """Whether a node is of a kind; a number that an EDS leaves zero fits any."""
    names = ("device_type", "vendor", "product")
    return all(want in (0, numbers.get(name)) for want, name in zip(kind, names, strict=True))


class QuietMaster(Master):
    """A master that publishes no contacts: the places of its boards are not known.

    ``on_pressures`` is called with the time of each cycle and its pressures (n_tactels,) Pa, zeros not
    subtracted; what was not read is NaN.
    """

    def __init__(self, arm: Arm, on_pressures: Callable[[int, Floats], object]) -> None:
        super().__init__(arm, level="kmeans", on_cycle=self._hand_over)  # its contacts are not used
        objects = usual(self.device.node_id)
        self._withheld = frozenset((*objects.contact_ids, objects.summary.cob_id, objects.load.cob_id))
        self._on_pressures = on_pressures

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """As a master, without its TPDOs; zeros that lie elsewhere than the files say are no event."""
        step = super().step(now_ns, frames)
        events = [event for event in step.events if event.kind not in UNSAID]
        return Step(
            [frame for frame in step.frames if frame.can_id not in self._withheld], events, step.wake_ns
        )

    def _hand_over(self, report: CycleReport) -> None:
        plan, arm = self.gather.plan, self.arm
        pressures = (self.gather.counts - plan.counts_offset) * (plan.counts_scale * arm.tactel_gain)
        pressures[~report.fresh[arm.tactel_patch]] = np.nan
        self._on_pressures(report.t_ns, pressures)


SERIAL = 3
"""Of the numbers of an identity."""


def places_of(arm: Arm, mountings: Sequence[Mounting]) -> list[Place]:
    """Return the places of the patches of an arm with one bus, and of their tables in its file."""
    places = []
    for placed, mounting, kind in zip(arm.patches, mountings, kinds_of(arm), strict=True):
        link = arm.links[placed.link]
        where = f"{link.name}, s {1e3 * placed.s:.0f} mm"
        if link.surface.period:
            where += f", angle {math.degrees(placed.a / link.surface.radius):.0f} deg"
        else:
            where += f", a {1e3 * placed.a:.0f} mm"
        around = "larger angle" if link.surface.period else "larger a"
        places.append(Place(mounting.key, where, kind.kind, placed.patch.size, placed.yaw, around))
    return places


def changes_of(mountings: Sequence[Mounting], found: Mapping[str, Identified]) -> dict[str, dict[str, Any]]:
    """Return what is to change in the tables of an arm file, by key.

    The file of a board that was calibrated goes where the board is: it is known by its serial number, else by
    its node-ID. A place at which no board was found gets a node-ID that is left when another place has its.
    """
    changes: dict[str, dict[str, Any]] = {}
    taken = {own.node_id for own in found.values()}
    left = [m.node_id for m in mountings if m.node_id not in taken]
    kept = {m.node_id for m in mountings if m.key not in found} - taken
    spare = [node_id for node_id in left if node_id not in kept]
    for mounting in mountings:
        own = found.get(mounting.key)
        change: dict[str, Any] = {}
        if own is None:
            if mounting.node_id in taken and spare:
                change["node_id"] = spare.pop(0)
        else:
            change = _change(mounting, own)
            eds = _eds_of(own, mountings)
            if eds and eds != mounting.eds:
                change["eds"] = eds
        if change:
            changes[mounting.key] = change
    return changes


def _change(mounting: Mounting, own: Identified) -> dict[str, Any]:
    serial = own.identity[SERIAL]
    change: dict[str, Any] = {}
    if own.node_id != mounting.node_id:
        change["node_id"] = own.node_id
    if serial and serial != mounting.serial:
        change["serial"] = serial
    if abs(math.remainder(own.yaw - mounting.yaw, math.tau)) > 1e-6:
        change["yaw_deg"] = round(math.degrees(own.yaw), 3)
    if own.mirrored != mounting.is_mirrored:
        change["mirrored"] = True if own.mirrored else None
    return change


def _eds_of(own: Identified, mountings: Sequence[Mounting]) -> str | None:
    """Return the file that describes a board, if the arm file names one for it."""
    serial = own.identity[SERIAL]
    for mounting in mountings:
        if serial and mounting.serial == serial:
            return mounting.eds
    return next((m.eds for m in mountings if m.node_id == own.node_id and m.serial == 0), None)
