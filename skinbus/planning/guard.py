"""How long a patch with limits takes at worst from a reading that exceeds one to GFC, and to standstill.

The reading is what the board has: how long a cover takes to pass on a force is not in it.
"""

from __future__ import annotations

from typing import NamedTuple

from skinbus.can.classic import worst_case_bits
from skinbus.model.guard import GuardSettings
from skinbus.objects.guard import GFC_ID, liveness_pdo
from skinbus.objects.profile import GUARD_PERIOD_US, current, look_up
from skinbus.planning.plan import Plan
from skinbus.planning.schedule import NO_ERRORS, SECOND, ErrorModel, Message, response_times

GFC = Message(name="GFC", cob_id=GFC_ID, bits=worst_case_bits(0), period_ns=60 * SECOND)
"""A guard that has tripped is latched; a minute is less than anybody takes to acknowledge it twice."""


class Part(NamedTuple):
    """A part of the time, and what is assumed of it."""

    name: str
    ns: int
    assumed: str


class GuardBound(NamedTuple):
    """The parts that come one after another."""

    to_frame: tuple[Part, ...]
    to_standstill: tuple[Part, ...]
    """What follows the frame."""

    @property
    def frame_ns(self) -> int:
        """Until GFC is on the wire."""
        return sum(part.ns for part in self.to_frame)

    @property
    def standstill_ns(self) -> int:
        """Until the robot stands."""
        return self.frame_ns + sum(part.ns for part in self.to_standstill)


def guard_bound(plan: Plan, guard: GuardSettings) -> GuardBound | None:
    """Return the bound of the patches on a bus; None if none of them has limits."""
    guarded = [od for od in plan.ods if (pdo := liveness_pdo(od)) and pdo.valid]
    if not guarded:
        return None
    period_ns = 1000 * max(int(str(current(look_up(od, GUARD_PERIOD_US)))) for od in guarded)
    first = [m for m in plan.traffic.messages if m.cob_id < GFC_ID]
    others = [m for m in plan.traffic.messages if m.cob_id > GFC_ID]
    parts = [
        Part("next sample", period_ns, f"one each {period_ns / 1e6:g} ms (0x2080:04)"),
        Part("more samples", (guard.n - 1) * period_ns, f"{guard.n} of {guard.m} exceed a limit"),
        Part("comparison", plan.response_ns, "as long as an answer to SYNC takes"),
    ]
    before = 0
    for name, among, errors, assumed in (
        ("GFC", [], NO_ERRORS, "from a mailbox of its own; those of other patches are the same frame"),
        ("frame under way", others, NO_ERRORS, "the longest of any node has just begun"),
        ("NMT", [*first, *others], NO_ERRORS, "one command, which alone has priority"),
        ("bit error", [*first, *others], ErrorModel(burst=1), "one, with the error frame and a repetition"),
    ):
        end = (
            response_times([GFC, *among], plan.bitrate, errors)[GFC_ID] or 0
        )  # below them is next to nothing
        parts.append(Part(name, end - before, assumed))
        before = end
    return GuardBound(
        tuple(parts),
        (
            Part("process or relay", guard.reaction_ns, "reaction_ms of the arm file"),
            Part("stop", guard.stop_ns, "stop_ms of the arm file"),
        ),
    )
