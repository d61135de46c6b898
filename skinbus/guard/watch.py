"""The guard as a core: it waits until every guarded patch is armed, guards, and stops; stopped is for ever.

A stop is, at whatever time: GFC. While it guards: a patch that is not exactly armed or says nothing for
``SILENT`` periods of its liveness, a master whose heartbeat is missing for as many of its periods, a bus that
is lost, a contact beyond the limits of its region, contacts that are missing where they are wanted, and an
order to end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Floats
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import EXTENDED, NO_DATA, Frame, Frames
from skinbus.guard.stops import NodeStop, Writer
from skinbus.model import Arm
from skinbus.model.guard import GuardSettings
from skinbus.node.sdo_client import SdoClient
from skinbus.objects.cia import EMCY_BASE, HEARTBEAT_BASE, NmtState, describe_emcy
from skinbus.objects.guard import GFC_ID, GuardState
from skinbus.objects.profile import MASTER_NODE_ID

SILENT = 2.5
"""Periods without a sign of life that are a stop: one frame may be lost, two may not. The half is for the
jitter of bus and machine, with which the frame after a lost one comes."""

CYCLES = 10
"""Periods of SYNC after which contacts are stale: a master that was held up for a few cycles goes on."""

LOOK_NS = 10_000_000
"""What other threads have left is looked at so often: contacts, and the order to end."""

ALIVE = {int(state) for state in NmtState} - {int(NmtState.INITIALISING)}


class Phase(Enum):
    """How far a guard is; it only goes on."""

    WAITING = "waiting"
    GUARDING = "guarding"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardedPatch:
    """A patch that is waited for and watched."""

    label: str
    bus: int
    node_id: int
    cob_id: int
    """Of the TPDO with the state of its guard."""


class SeenContacts(NamedTuple):
    """Contacts of one cycle, (n,) each."""

    t_ns: int
    """Of its SYNC, by the clock of this machine."""
    link: npt.NDArray[np.integer]
    s: Floats
    a: Floats
    force: Floats
    """N."""


@dataclass(slots=True)
class _Life:
    """Signs of life of a patch or a master."""

    label: str
    allowed_ns: int
    since: str
    seen_ns: int | None = None
    """When it was last as it should be; None when it is not."""

    def fault(self, now_ns: int) -> str:
        """Why it is not as it should be; nothing when it is."""
        seen_ns = self.seen_ns  # another thread may ask
        if seen_ns is None:
            return f"{self.label}: {self.since}"
        silent_ns = now_ns - seen_ns
        return f"{self.label}: silent for {1e-6 * silent_ns:.0f} ms" if silent_ns > self.allowed_ns else ""


class Guard(Core):
    """Watches all buses of an arm; ``contacts`` and ``end`` are for another thread."""

    def __init__(
        self,
        arm: Arm,
        settings: GuardSettings,
        patches: Sequence[GuardedPatch],
        stops: Sequence[NodeStop],
        *,
        master_period_ns: int,
        needs_contacts: bool = False,
        acknowledge: tuple[int, int, bytes] | None = None,
    ) -> None:
        """``acknowledge``: index, sub-index and value to write to patches that had tripped before."""
        self.phase = Phase.WAITING
        self.reason = ""
        """Why it has stopped."""
        self.contacts: SeenContacts | None = None
        """The newest, as another thread read them; None where there are none to read."""
        self._arm, self._settings, self._needs_contacts = arm, settings, needs_contacts
        self._period_ns = round(1e9 / arm.bus.rate_hz)
        self._writers = [Writer(stop) for stop in stops]
        self._acknowledge = acknowledge
        self._clients: dict[GuardedPatch, SdoClient] = {}
        self._order = ""
        self._now_ns = 0
        self._events: list[Event] = []
        self._seen: SeenContacts | None = None
        self._had_contacts = True
        self._judged_ns = -1
        self._above_ns: dict[int, int] = {}
        self._lives: list[_Life] = []
        self._handlers: dict[tuple[int, int], Callable[[Frame], None]] = {}
        allowed_ns = round(SILENT * settings.liveness_ns)
        for patch in patches:
            life = _Life(f"patch {patch.label}", allowed_ns, "not armed")
            self._lives.append(life)
            self._handlers[patch.bus, patch.cob_id] = partial(self._take_state, patch, life)
            self._handlers[patch.bus, EMCY_BASE + patch.node_id] = partial(self._take_emcy, patch)
        for bus, named in enumerate(arm.buses):
            label = f"master on {named.name}" if named.name else "master"
            life = _Life(label, round(SILENT * master_period_ns), "no heartbeat")
            self._lives.append(life)
            self._handlers[bus, HEARTBEAT_BASE + MASTER_NODE_ID] = partial(self._take_heartbeat, life)
        answers = [(writer.stop.bus, writer.client.answer_id) for writer in self._writers]
        answers += [(patch.bus, SdoClient(patch.node_id).answer_id) for patch in patches if acknowledge]
        heard = {*self._handlers, *answers, *((bus, GFC_ID) for bus in range(self.n_buses))}
        self._cob_ids = [frozenset(i for k, i in heard if k == bus) for bus in range(self.n_buses)]

    @property
    def n_buses(self) -> int:
        """Those of the arm."""
        return len(self._arm.buses)

    @property
    def cob_ids(self) -> frozenset[int]:
        """GFC, liveness and EMCY of the patches, heartbeat of the master, answers of the nodes that stop."""
        return self._cob_ids[0]

    def cob_ids_on(self, bus: int) -> frozenset[int]:
        """The same on each bus."""
        return self._cob_ids[bus]

    @property
    def is_confirmed(self) -> bool:
        """Whether every node has taken the value that stops it."""
        return all(writer.is_confirmed for writer in self._writers)

    def end(self, reason: str) -> None:
        """Stop the robot if it is guarded; for another thread."""
        self._order = reason

    def waits_for(self, now_ns: int) -> list[str]:
        """What is not as it should be."""
        faults = [life.fault(now_ns) for life in self._lives]
        missing = self._needs_contacts and not self._has_contacts(now_ns)
        return [*filter(None, faults), *["contacts"] * missing]

    def bus_news(self, now_ns: int, event: Event) -> None:
        """Nothing can be heard on a bus that is lost."""
        if event.kind is EventKind.BUS_LOST and self.phase is Phase.GUARDING:
            self._now_ns = now_ns
            self._stop(f"bus {self._arm.buses[event.bus].name or event.bus} is lost: {event.detail}")

    def last_frames(self, now_ns: int) -> Frames:
        """Stop the robot, when the process can no longer guard it: what is to be sent at once."""
        self._now_ns = now_ns
        if self.phase is Phase.GUARDING:
            self._stop(self._order or "the guard ended by a fault")
        return self._write(()) if self.phase is Phase.STOPPED else ()

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take frames and look whether all is well."""
        self._now_ns, self._seen = now_ns, self.contacts
        for frame in frames:  # before anything else that came with it
            if frame.can_id == GFC_ID and not frame.flags & (EXTENDED | NO_DATA):
                self._stop("GFC: a patch or another node demands a stop")
        for frame in frames:
            handler = self._handlers.get((frame.bus, frame.can_id))
            if handler and not frame.flags:
                handler(frame)
        self._look()
        out = self._write(frames) if self.phase is Phase.STOPPED else []
        for patch, client in self._clients.items():
            own = [frame for frame in frames if frame.bus == patch.bus]
            out += [frame._replace(bus=patch.bus) for frame in client.step(now_ns, own)]
        events, self._events = self._events, []
        return Step(out, events, min(self._wakes(), default=NEVER))

    def _wakes(self) -> Iterator[int]:
        yield self._now_ns + LOOK_NS
        if self.phase is Phase.STOPPED:
            yield from (writer.wake_ns for writer in self._writers)
        else:
            yield from (
                life.seen_ns + life.allowed_ns + 1 for life in self._lives if life.seen_ns is not None
            )
        yield from (client.wake_ns for client in self._clients.values())

    def _take_state(self, patch: GuardedPatch, life: _Life, frame: Frame) -> None:
        """Take the state of the guard of a patch: anything but exactly ARMED is a stop."""
        if len(frame.data) != 2:
            return
        state, tripped_by = frame.data
        if state == GuardState.ARMED:
            life.seen_ns = min(frame.t_ns, self._now_ns)
            return
        before = life.since
        life.seen_ns = None
        life.since = "not armed"
        if state & GuardState.TRIPPED:
            life.since = f"tripped by {f'tactel {tripped_by}' if tripped_by else 'the sum of its tactels'}"
            if life.since != before:
                self._report(EventKind.GUARD_TRIPPED, life.since, patch)
            if self._acknowledge and self.phase is Phase.WAITING and patch not in self._clients:
                self._clients[patch] = SdoClient(patch.node_id)
                self._clients[patch].start_write(*self._acknowledge)

    def _take_emcy(self, patch: GuardedPatch, frame: Frame) -> None:
        if len(frame.data) == 8 and (code := int.from_bytes(frame.data[:2], "little")):
            self._report(EventKind.PATCH_EMCY, describe_emcy(code, frame.data[3:]), patch)

    def _take_heartbeat(self, life: _Life, frame: Frame) -> None:
        if len(frame.data) == 1 and frame.data[0] in ALIVE:
            life.seen_ns = min(frame.t_ns, self._now_ns)

    def _look(self) -> None:
        """Go on to guarding when all is well, and to the stop when something is not."""
        if (has := self._has_contacts(self._now_ns)) != self._had_contacts:
            self._had_contacts = has
            self._report(EventKind.CONTACTS_BACK if has else EventKind.CONTACTS_LOST)
        if self.phase is Phase.STOPPED:
            return
        faults = self.waits_for(self._now_ns)
        if self.phase is Phase.WAITING and not faults and not self._order:
            self.phase = Phase.GUARDING
            self._report(EventKind.GUARDING)
        if self.phase is Phase.GUARDING:
            if faults:
                self._stop("; ".join(faults))
            elif self._order:
                self._stop(self._order)
            elif self._seen is not None and self._seen.t_ns != self._judged_ns:
                self._judge(self._seen)

    def _has_contacts(self, now_ns: int) -> bool:
        seen = self._seen
        return seen is not None and abs(now_ns - seen.t_ns) <= CYCLES * self._period_ns

    def _judge(self, seen: SeenContacts) -> None:
        """Compare contacts with the limits of the regions that they are in."""
        self._judged_ns = seen.t_ns
        inside = regions_of(self._arm, self._settings, seen)
        for k, (region, here) in enumerate(zip(self._settings.regions, inside, strict=True)):
            force = float(np.fmax.reduce(seen.force[here], initial=0.0))
            if not force > region.force:
                self._above_ns.pop(k, None)
                continue
            since_ns = self._above_ns.setdefault(k, seen.t_ns)
            factor, lasts_ns = region.transient_factor, seen.t_ns - since_ns
            if force > factor * region.force or lasts_ns > self._settings.transient_ns:
                beyond = f"beyond {region.force:g} N" + (f" for {1e-6 * lasts_ns:.0f} ms" if lasts_ns else "")
                self._stop(f"contact of {force:.1f} N in region {region.name}, {beyond}")

    def _stop(self, reason: str) -> None:
        if self.phase is not Phase.STOPPED:
            self.phase, self.reason = Phase.STOPPED, reason
            self._report(EventKind.GUARD_STOP, reason)

    def _write(self, frames: Frames) -> list[Frame]:
        out: list[Frame] = []
        for writer in self._writers:
            sent, events = writer.step(self._now_ns, frames)
            out += sent
            self._events += events
        return out

    def _report(self, kind: EventKind, detail: str = "", patch: GuardedPatch | None = None) -> None:
        node_id, bus = (patch.node_id, patch.bus) if patch else (0, 0)
        self._events.append(Event(t_ns=self._now_ns, kind=kind, node_id=node_id, detail=detail, bus=bus))


def regions_of(arm: Arm, settings: GuardSettings, seen: SeenContacts) -> list[Bools]:
    """Return which contacts are in which region, (n,) each: where the nearest tactel of the link is."""
    nearest = np.full(len(seen.link), -1)
    for link in np.unique(seen.link):
        here, own = seen.link == link, np.flatnonzero(arm.tactel_link == link)
        if len(own):
            nearest[here] = own[arm.distance(own, seen.s[here], seen.a[here]).argmin(-1)]
    return [(nearest >= 0) & region.tactels[nearest] for region in settings.regions]
