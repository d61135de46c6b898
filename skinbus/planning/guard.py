"""How long a patch with limits takes at worst from a reading that exceeds one to GFC, and to standstill.

The reading is what the board has: how long a cover takes to pass on a force is not in it.
"""

from __future__ import annotations

from typing import NamedTuple

from skinbus.can.classic import worst_case_bits
from skinbus.model.guard import GuardSettings
from skinbus.objects.guard import GFC_ID, liveness_pdo
from skinbus.objects.profile import GUARD_PERIOD_US, index_of, number_at
from skinbus.planning.plan import Plan
from skinbus.planning.schedule import ERROR_FRAME_BITS, frame_ns


class Part(NamedTuple):
    """A part of the time, and what is assumed of it."""

    name: str
    ns: int
    assumed: str


class GuardBound(NamedTuple):
    """The bound on one bus."""

    parts: tuple[Part, ...]
    """One after another, until GFC is on the wire."""
    frame_ns: int
    """Their sum."""
    standstill_ns: int
    """With the times that the arm file assumes of process or relay, and of the robot."""


def guard_bound(plan: Plan, guard: GuardSettings) -> GuardBound | None:
    """Return the bound of the patches on a bus; None if none of them has limits."""
    guarded = [od for od in plan.ods if (pdo := liveness_pdo(od)) and pdo.valid]
    if not guarded:
        return None
    period_ns = 1000 * max(number_at(od, *index_of(od, GUARD_PERIOD_US)) for od in guarded)
    gfc_ns = frame_ns(worst_case_bits(0), plan.bitrate)
    before = [m.ns(plan.bitrate) for m in plan.traffic.messages if m.cob_id < GFC_ID]
    longest_ns = max(m.ns(plan.bitrate) for m in plan.traffic.messages if m.cob_id > GFC_ID)
    error_ns = frame_ns(ERROR_FRAME_BITS, plan.bitrate) + max(gfc_ns, *before)
    parts = (
        Part("next sample", period_ns, f"one each {period_ns / 1e6:g} ms (0x2080:04)"),
        Part("more samples", (guard.n - 1) * period_ns, f"{guard.n} of {guard.m} exceed a limit"),
        Part("comparison", plan.response_ns, "as long as an answer to SYNC takes"),
        Part("frame under way", longest_ns, "the longest of any node has just begun"),
        Part("NMT", sum(before), "one command, which alone has priority"),
        Part("GFC", gfc_ns, "from a mailbox of its own; those of other patches are the same frame"),
        Part("bit error", error_ns, "one: an error frame, and what it hit is sent again"),
    )
    sent_ns = sum(part.ns for part in parts)
    return GuardBound(parts, sent_ns, sent_ns + guard.reaction_ns + guard.stop_ns)
