"""Boards whose places are not known: the nodes of a bus as an arm of which only pressures are read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from skinbus.arrays import Floats
from skinbus.can.core import Step
from skinbus.can.event import EventKind
from skinbus.can.frame import Frames
from skinbus.config.placement import Mounting, keys_of
from skinbus.config.system import ods_of
from skinbus.master.commissioning.identification import Board, Identified, Place
from skinbus.master.commissioning.scan import Found
from skinbus.master.cycle import CycleReport
from skinbus.master.master import Master
from skinbus.master.patches.provisioning import NUMBERS
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface
from skinbus.objects.board import describe_patch
from skinbus.objects.profile import number_at
from skinbus.objects.published import usual

Kind = tuple[int, ...]

UNSAID = (EventKind.TACTELS_IMPLAUSIBLE, EventKind.TACTELS_IMPLAUSIBLE_END)

APART = 0.2
"""m, in the row of boards that stands for places not known: none is near another."""


N_KIND = 3
"""Of the numbers of an identity, those that boards of a kind have in common: up to the product."""


class BoardKind(NamedTuple):
    """A kind of boards: what the arm file has of it."""

    kind: Kind
    """Device type, vendor and product; all boards of an arm that have them alike are of one kind."""
    patch: Patch
    """Not mirrored, whatever the arm file says of its place."""
    placed: PlacedPatch


def kinds_of(arm: Arm) -> list[BoardKind]:
    """Return the kind of every patch of an arm."""
    kinds = []
    for placed, od in zip(arm.patches, ods_of(arm), strict=True):
        kind = tuple(number_at(od, index, sub) for _, index, sub in NUMBERS[:N_KIND])
        kinds.append(BoardKind(kind, describe_patch(od, placed.eds), placed))
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
        numbers = [node.numbers.get(name) or 0 for name, _, _ in NUMBERS]
        # a number that an EDS leaves zero fits any; a board is configured as the patch with its node-ID
        own = max(
            (own for own in kinds if all(w in (0, n) for w, n in zip(own.kind, numbers, strict=False))),
            key=lambda own: own.placed.node_id == node.node_id,
            default=None,
        )
        if own is None:
            strangers.append(node.node_id)
            continue
        uv, threshold = own.patch.tactels_uv, own.patch.threshold
        boards.append(Board(node.node_id, own.kind, uv, threshold, numbers[-1]))
        patches.append(
            PlacedPatch(
                patch=own.patch,
                node_id=node.node_id,
                link=0,
                s=APART * (len(patches) + 1),
                a=0.0,
                eds=own.placed.eds,
                settings=own.placed.settings,
            )
        )
    if not boards:
        return None
    plane = Link("not placed", Surface.plane(APART * (len(patches) + 1), APART))
    return Unplaced(boards, Arm(arm.name, [plane], patches, arm.bus), strangers)


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

    def step(self, now_ns: int, frames: Frames) -> Step:
        """As a master, without its TPDOs; zeros that lie elsewhere than the files say are no event."""
        step = super().step(now_ns, frames)
        events = [event for event in step.events if event.kind not in UNSAID]
        return Step(
            [frame for frame in step.frames if frame.can_id not in self._withheld], events, step.wake_ns
        )

    def _hand_over(self, report: CycleReport) -> None:
        plan = self.gather.plan
        pressures = (self.gather.counts - plan.counts_offset) * plan.counts_scale
        pressures[~report.fresh[self.arm.tactel_patch]] = np.nan
        self._on_pressures(report.t_ns, pressures)


def places_of(arm: Arm) -> list[Place]:
    """Return the places of the patches of an arm with one bus, and of their tables in its file."""
    places = []
    for placed, kind in zip(arm.patches, kinds_of(arm), strict=True):
        link = arm.links[placed.link]
        at = keys_of(link.surface, placed.s, placed.a).items()
        words = [link.name, *(key.replace("_", f" {value:.0f} ") for key, value in at)]
        places.append(Place(placed.key, ", ".join(words), kind.kind, placed.patch.size))
    return places


def changes_of(mountings: Sequence[Mounting], found: Mapping[str, Identified]) -> dict[str, dict[str, Any]]:
    """Return what is to change in the tables of an arm file, by key.

    The file of a board that was calibrated goes where the board is: it is known by its serial number, else by
    its node-ID. A place at which no board was found gets a node-ID that is left when another place has its.
    """
    changes: dict[str, dict[str, Any]] = {}
    taken = {own.node_id for own in found.values()}
    lost = [mounting for mounting in mountings if mounting.key not in found]
    spare = (
        {mounting.board.node_id for mounting in mountings}
        - taken
        - {mounting.board.node_id for mounting in lost}
    )
    for mounting in mountings:
        if own := found.get(mounting.key):
            changes[mounting.key] = _change(mounting, own, mountings)
        elif mounting.board.node_id in taken and spare:
            changes[mounting.key] = {"node_id": min(spare)}
            spare.remove(min(spare))
    return {key: change for key, change in changes.items() if change}


def _change(mounting: Mounting, own: Identified, mountings: Sequence[Mounting]) -> dict[str, Any]:
    serial = own.serial
    change: dict[str, Any] = {}
    if own.node_id != mounting.board.node_id:
        change["node_id"] = own.node_id
    if serial and serial != mounting.board.serial:
        change["serial"] = serial
    known = [m.board.eds for m in mountings if serial and m.board.serial == serial]
    known += [m.board.eds for m in mountings if m.board.node_id == own.node_id and m.board.serial == 0]
    if known and known[0] and known[0] != mounting.board.eds:
        change["eds"] = known[0]
    return change
