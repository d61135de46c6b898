"""The guard as a core: it waits until every guarded patch is armed, guards, and stops; stopped is for ever.

A stop is, at whatever time: GFC. While it guards: a patch that is not exactly armed or says nothing for
``SILENT`` periods of its liveness, a master whose heartbeat is missing for as many of its periods, a contact
beyond the limits of its region, contacts that are missing where they are wanted, and an order to end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import NamedTuple

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.arrays import Floats, Ints
from skinbus.can.core import Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import EXTENDED, NO_DATA, Frame, Frames
from skinbus.guard.stops import NodeWrite
from skinbus.model import Arm
from skinbus.model.guard import GuardSettings
from skinbus.node.guard import TRIP
from skinbus.objects import cia
from skinbus.objects.guard import GFC_ID, GuardState, liveness_pdo
from skinbus.objects.profile import ACKNOWLEDGE, GUARD_ACKNOWLEDGE, MASTER_NODE_ID, index_of, number_at
from skinbus.objects.published import master_od

SILENT = 2.5
"""Periods without a sign of life that are a stop: one frame may be lost, two may not. The half is for the
jitter of bus and machine, with which the frame after a lost one comes."""

CYCLES = 10
"""Periods of SYNC after which contacts are stale: a master that was held up for a few cycles goes on."""

LOOK_NS = 10_000_000
"""What other threads have left is looked at so often: contacts, and the order to end."""

SAY_NS = 1_000_000_000
"""What is waited for is said so often, if it has changed."""

NAMED = 4
"""Of those that are not well, so many are named."""

ENDED = "the guard was asked to end"


class Phase(Enum):
    """How far a guard is; it only goes on."""

    WAITING = "waiting"
    GUARDING = "guarding"
    STOPPED = "stopped"


class RegionPeaks(NamedTuple):
    """What presses most on each region, in one cycle."""

    t_ns: int
    """Of its SYNC, by the clock of this machine."""
    forces: Sequence[float]
    """N, of a contact."""
    pressures: Sequence[float]
    """Pa, of a tactel: patches compare with the transient factor, too, for however long it lasts."""


@dataclass(slots=True)
class _Watched:
    """Somebody whose signs of life are watched."""

    label: str
    allowed_ns: int
    bus: int = 0
    node_id: int = 0
    due_ns: int = -1
    """The next sign of life must be there by then."""
    state: str = "silent"
    acknowledge: NodeWrite | None = None
    """Takes a trip back, if it had tripped before."""


class Guard(Core):
    """Watches all buses of an arm."""

    def __init__(
        self,
        arm: Arm,
        settings: GuardSettings,
        ods: Sequence[ObjectDictionary],
        stops: Sequence[NodeWrite],
        *,
        needs_contacts: bool = False,
        acknowledges: bool = False,
    ) -> None:
        """``acknowledges``: trips of patches from before are taken back.

        ods: dictionaries of the patches of the arm
        """
        self.phase, self.reason = Phase.WAITING, ""
        self.is_ending = False
        """Stop if it guards; another thread sets it."""
        self.contacts: RegionPeaks | None = None
        """The newest, None while there are none; another thread sets it."""
        self._settings, self._stops, self._acknowledges = settings, stops, acknowledges
        self.n_buses = len(arm.buses)
        self._now_ns = self._say_ns = 0
        self._said = ""
        self._events: list[Event] = []
        self._above_ns: dict[tuple[int, str], int] = {}
        self._has_contacts = needs_contacts
        self._contacts = _Watched("contacts", round(CYCLES * 1e9 / arm.bus.rate_hz))
        self._watched = [self._contacts] if needs_contacts else []
        self._handlers: dict[tuple[int, int], Callable[[Frame], None]] = {}
        writes = [*stops]
        for p in np.flatnonzero(arm.guarded).tolist():
            bus, node_id, liveness = arm.patches[p].bus, arm.patches[p].node_id, liveness_pdo(ods[p])
            patch = _Watched(f"patch {arm.node_label(p)}", round(SILENT * settings.liveness_ns), bus, node_id)
            word, where = ACKNOWLEDGE.to_bytes(4, "little"), index_of(ods[p], GUARD_ACKNOWLEDGE)
            patch.acknowledge = NodeWrite.of("acknowledge", bus, node_id, *where, word)
            self._watched.append(patch)
            self._handlers[bus, liveness.cob_id if liveness else -1] = partial(self._take_state, patch)
            self._handlers[bus, cia.EMCY_BASE + node_id] = partial(self._take_emcy, patch)
            writes.append(patch.acknowledge)
        period_ms = number_at(master_od(), cia.HEARTBEAT_PRODUCER)
        for bus, named in enumerate(arm.buses):
            master = _Watched(f"master {named.name}".strip(), round(SILENT * 1e6 * period_ms), bus)
            self._watched.append(master)
            self._handlers[bus, cia.HEARTBEAT_BASE + MASTER_NODE_ID] = partial(self._take_heartbeat, master)
        heard = {*self._handlers, *((write.bus, write.answer_id) for write in writes)}
        self._cob_ids = [
            frozenset({GFC_ID, *(i for k, i in heard if k == bus)}) for bus in range(self.n_buses)
        ]

    def cob_ids_on(self, bus: int) -> frozenset[int]:
        """GFC, liveness and EMCY of the patches, heartbeat of the master, answers to what is written."""
        return self._cob_ids[bus]

    @property
    def is_settled(self) -> bool:
        """Whether there is nothing to be stopped, or every node has confirmed that it is."""
        return self.phase is Phase.WAITING or (
            self.phase is Phase.STOPPED and all(write.is_confirmed for write in self._stops)
        )

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take frames and look whether all is well."""
        self._now_ns = now_ns
        # before anything that came with it, and of any length: nobody else may send with this identifier
        if any(frame.can_id == GFC_ID and not frame.flags & (EXTENDED | NO_DATA) for frame in frames):
            self._stop("GFC")
        for frame in frames:
            take = self._handlers.get((frame.bus, frame.can_id))
            if take and not frame.flags:
                take(frame)
        self._look(self.contacts)
        writes = self._stops
        if self.phase is not Phase.STOPPED:
            tripped = [who.acknowledge for who in self._watched if who.state.startswith("tripped")]
            writes = [w for w in tripped if w and self._acknowledges and not w.is_confirmed]
        out: list[Frame] = []
        for write in writes:
            sent, news = write.step(now_ns, frames)
            out += sent
            self._events += news
        events, self._events = self._events, []
        due_ns = [who.due_ns + 1 for who in self._watched if who.due_ns >= now_ns]
        return Step(out, events, min([now_ns + LOOK_NS, *due_ns, *(write.due_ns for write in writes)]))

    def last_frames(self, now_ns: int) -> Frames:
        """Stop the robot if the process can no longer guard it: what is to be sent at once."""
        self._now_ns = now_ns
        if self.phase is Phase.GUARDING:
            self._stop(ENDED if self.is_ending else "the guard ends by a fault")
        # not by ``step``, which may be what has failed
        return [
            frame
            for write in self._stops
            for frame in write.step(now_ns, ())[0]
            if self.phase is Phase.STOPPED
        ]

    def _take_state(self, patch: _Watched, frame: Frame) -> None:
        """Take the state of the guard of a patch: anything but exactly ARMED is a stop."""
        if len(frame.data) != 2:
            return
        state, tripped_by = frame.data
        if state == GuardState.ARMED:
            patch.due_ns, patch.state = min(frame.t_ns, self._now_ns) + patch.allowed_ns, "silent"
            return
        before, patch.due_ns, patch.state = patch.state, -1, "not armed"
        if state & GuardState.TRIPPED:
            patch.state = f"tripped by {_where(tripped_by)}"
            if patch.state != before:
                self._report(EventKind.GUARD_TRIPPED, patch.state, patch)
        if self.phase is Phase.GUARDING:  # whatever it says next: somebody may acknowledge at once
            self._stop(f"{patch.label} {patch.state}")

    def _take_emcy(self, patch: _Watched, frame: Frame) -> None:
        """Say who and where; the state of the patch is what counts."""
        code = int.from_bytes(frame.data[:2], "little")
        if len(frame.data) == 8 and code == cia.EmcyCode.GUARD_TRIPPED:
            tactel, value = TRIP.unpack(frame.data[3:])
            self._report(EventKind.GUARD_TRIPPED, f"{_where(tactel)} reads {value} counts", patch)

    def _take_heartbeat(self, master: _Watched, frame: Frame) -> None:
        if frame.data in (b"\x04", b"\x05", b"\x7f"):  # a boot-up message is none
            master.due_ns = min(frame.t_ns, self._now_ns) + master.allowed_ns

    def _look(self, contacts: RegionPeaks | None) -> None:
        """Go on to guarding when all is well, and to the stop when something is not."""
        now_ns, seen = self._now_ns, self._contacts
        seen.due_ns = min(contacts.t_ns, now_ns) + seen.allowed_ns if contacts else -1
        if (has := now_ns <= seen.due_ns) != self._has_contacts:
            self._has_contacts = has
            self._report(EventKind.CONTACTS_BACK if has else EventKind.CONTACTS_LOST)
        late = [f"{who.label} {who.state}" for who in self._watched if now_ns > who.due_ns]
        faults = "; ".join(late[:NAMED]) + (f"; {len(late) - NAMED} more" if len(late) > NAMED else "")
        if self.phase is Phase.WAITING and faults not in ("", self._said) and now_ns >= self._say_ns:
            self._said, self._say_ns = faults, now_ns + SAY_NS
            self._report(EventKind.GUARD_WAITS, faults)
        if self.phase is Phase.WAITING and not faults and not self.is_ending:
            self.phase = Phase.GUARDING
            self._report(EventKind.GUARDING)
        if self.phase is Phase.GUARDING:
            if faults or self.is_ending:
                self._stop(faults or ENDED)
            elif contacts:
                self._judge(contacts)

    def _judge(self, contacts: RegionPeaks) -> None:
        """Compare the contacts of a cycle with the limits of their regions."""
        t_ns, *peaks = contacts
        for k, (region, force, pressure) in enumerate(zip(self._settings.regions, *peaks, strict=True)):
            for unit, value, limit in (("N", force, region.force), ("Pa", pressure, region.pressure)):
                key = k, unit  # names of regions may repeat
                if not value > limit:
                    self._above_ns.pop(key, None)
                    continue
                lasts_ns = t_ns - self._above_ns.setdefault(key, t_ns)
                if value > region.transient_factor * limit or lasts_ns > self._settings.transient_ns:
                    beyond = f"beyond {limit:g} {unit} for {lasts_ns // 1_000_000} ms"
                    self._stop(f"contact of {value:.1f} {unit} in region {region.name}, {beyond}")

    def _stop(self, reason: str) -> None:
        if self.phase is not Phase.STOPPED:
            self.phase, self.reason = Phase.STOPPED, reason
            self._report(EventKind.GUARD_STOP, reason)

    def _report(self, kind: EventKind, detail: str = "", who: _Watched | None = None) -> None:
        node_id, bus = (who.node_id, who.bus) if who else (0, 0)
        self._events.append(Event(t_ns=self._now_ns, kind=kind, node_id=node_id, detail=detail, bus=bus))


def _where(tactel: int) -> str:
    return f"tactel {tactel}" if tactel else "the sum of its tactels"


def region_forces(
    arm: Arm, settings: GuardSettings, link: Ints, s: Floats, a: Floats, force: Floats
) -> list[float]:
    """Return the largest force in each region, N, of contacts (n,): each is where its nearest tactel is."""
    largest = [0.0] * len(settings.regions)
    for k, newtons in enumerate(force.tolist()):
        own = np.flatnonzero(arm.tactel_link == link[k])
        if len(own) and newtons > 0.0:
            nearest = own[arm.distance(own, s[k], a[k]).argmin()]
            for r, region in enumerate(settings.regions):
                if region.tactels[nearest]:
                    largest[r] = max(largest[r], newtons)
    return largest
