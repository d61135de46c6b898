"""A listener that needs only skin-master.eds: the master's TPDOs as rows of contacts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from struct import Struct
from typing import Final, NamedTuple

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame
from skinbus.master.level_control import CycleFlags, split_flags
from skinbus.model import Arm, Surface
from skinbus.objects import cia, profile
from skinbus.objects.contacts import FORCE_STEP, LENGTH_STEP, ContactState
from skinbus.objects.published import usual

LIFT_SHOWN_NS = 500_000_000
"""A contact that has gone stays in the list this long: a person can read it."""

STALE_NS = 1_000_000_000
"""A master that has said nothing for so long is gone, and what it said is no longer shown."""

BEYOND_M = 0.05
"""A contact further than a board beyond the ends of a link is not on it."""

_PAYLOAD: Final = Struct("<BBhhH")
"""A contact: id, link and state, s, a, force."""


class ContactRow(NamedTuple):
    """One contact as its TPDO says it: SI units."""

    slot: int
    id: int
    link: int
    state: ContactState
    s: float
    a: float
    force: float
    t_ns: int


class Summary(NamedTuple):
    """The summary TPDO."""

    counter: int
    n_contacts: int
    alive: int
    flags: CycleFlags
    level: str | None
    """None where the master does not say."""
    compute_us: int
    latency_us: int
    t_ns: int


def why_not_of(arm: Arm, summary: Summary | None, rows: Iterable[ContactRow]) -> str | None:
    """Return why what a master says cannot be of an arm; None where it may be."""
    if summary is not None and summary.alive > arm.n_patches:
        return f"{summary.alive} patches are at work, {arm.name} has {arm.n_patches}"
    for row in rows:
        if row.link >= len(arm.links):
            return f"a contact is on link {row.link}, {arm.name} has {len(arm.links)}"
        link = arm.links[row.link]
        surface, a = link.surface, abs(float(link.surface.wrap(row.a)))
        is_along = -BEYOND_M <= row.s <= surface.length + BEYOND_M
        is_on = is_along and a <= 0.5 * surface.width + BEYOND_M
        if type(surface) is Surface and not is_on:  # the chart of a mesh begins anywhere
            where = f"s {1e3 * row.s:.0f} mm, a {1e3 * row.a:.0f} mm"
            return f"a contact is at {where}, which link {link.name} does not have"
    return None


class Listener(Core):
    """A core that only listens; ``rows`` and ``summary`` hold what the master said last."""

    cob_ids: frozenset[int] = frozenset()

    def __init__(self, node_id: int = profile.MASTER_NODE_ID) -> None:
        objects = usual(node_id)
        self.slot_of = {cob_id: slot for slot, cob_id in enumerate(objects.contact_ids)}
        """Slot of the contact that a TPDO carries, by identifier."""
        self.summary_id = objects.summary.cob_id
        """Identifier of the summary TPDO."""
        self._heartbeat_id = cia.HEARTBEAT_BASE + node_id
        self.cob_ids = frozenset(self.slot_of) | {self.summary_id, self._heartbeat_id}
        self._rows: dict[int, ContactRow] = {}
        self.summary: Summary | None = None
        self.n_summaries = 0
        self.last_heard_ns = -NEVER

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames; nothing is ever sent."""
        for frame in frames:
            slot = self.slot_of.get(frame.can_id)
            if slot is not None and len(frame.data) == _PAYLOAD.size:
                self._take_contact(now_ns, slot, frame.data)
            elif frame.can_id == self.summary_id and len(frame.data) == 8:
                self._take_summary(now_ns, frame.data)
            elif frame.can_id != self._heartbeat_id:
                continue
            self.last_heard_ns = now_ns
        return Step((), (), NEVER)

    def row(self, slot: int) -> ContactRow | None:
        """Return what was last said of the contact in a slot."""
        return self._rows.get(slot)

    def rows(self, now_ns: int) -> list[ContactRow]:
        """Return the contacts shown now, by slot; none when the master has fallen silent."""
        if now_ns - self.last_heard_ns > STALE_NS:
            return []
        return [
            row
            for _, row in sorted(self._rows.items())
            if now_ns - row.t_ns < (LIFT_SHOWN_NS if row.state is ContactState.LIFT else STALE_NS)
        ]

    def _take_contact(self, now_ns: int, slot: int, data: bytes) -> None:
        id, link_state, s, a, force = _PAYLOAD.unpack(data)
        if link_state >> 4 <= max(ContactState):  # states of another profile are left out
            state, place = ContactState(link_state >> 4), (s * LENGTH_STEP, a * LENGTH_STEP)
            self._rows[slot] = ContactRow(
                slot, id, link_state & 0xF, state, *place, force * FORCE_STEP, now_ns
            )

    def _take_summary(self, now_ns: int, data: bytes) -> None:
        compute_us, latency = int.from_bytes(data[4:6], "little"), int.from_bytes(data[6:8], "little")
        self.summary = Summary(
            data[0], data[1], data[2], *split_flags(data[3]), compute_us, 10 * latency, now_ns
        )
        self.n_summaries += 1
