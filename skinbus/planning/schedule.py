"""Worst-case response times on a CAN bus: non-preemptive fixed priorities, and cycles that a SYNC releases.

Any set of messages (:func:`response_times`)::

    B  = max C of lower priority             blocking by a frame that has just begun
    t  = B + sum_hep ceil((t + J_k) / T_k) C_k                          busy period
    w  = B + q C_m + sum_hp ceil((w + J_k + bit) / T_k) C_k             start of instance q = 0, 1, ...
    R  = max_q (J_m + w - q T_m + C_m)

A cycle (:func:`cycle_times`): readings are released by the end of the SYNC frame (and a response time of
the patch), what the master publishes by the last reading (and a compute time). So none of them meets the
others of another cycle, as long as a cycle ends within its period; times count from queueing the SYNC::

    w = B_sync + C_sync + response + B' + sum_hr C_k + sum_hs ceil((w + J_k + bit) / T_k) C_k

Errors: a frame that is hit is followed by an error frame and sent again. Within a window t at most

    E(t) = (burst + ceil(t / T_error)) (31 bits + C_max)

is lost, which adds to w and t above; C_max is the longest frame of the priority in question or higher.

with hr, hs: readings and sporadic messages of higher priority. B' is the blocking by a frame that begins
while patches respond, readings of faster ones included; without a response time there is none, for
readings then take part in the arbitration that follows the SYNC. Times are integers, ns.

Source: Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis: refuted,
revisited and revised", Real-Time Systems 35 (2007), eq. 3-4, 8-13; offsets as in Palencia and Gonzalez
Harbour, RTSS 1998, reduced to one transaction; errors: Tindell, Burns, "Guaranteeing message latencies on
CAN", 1994, and section 6 of the first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

SECOND = 1_000_000_000


class Release(Enum):
    """What lets a message go."""

    SPORADIC = "sporadic"
    """Nothing else on the bus: at any time, at least a period apart."""
    SYNC = "sync"
    """The SYNC itself: the beginning of a cycle."""
    READING = "reading"
    """The end of the SYNC frame."""
    PUBLISHED = "published"
    """The last reading of the cycle, and the time to compute."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """One identifier: the lower the COB-ID, the higher the priority."""

    name: str
    cob_id: int
    bits: int
    """Longest frame, interframe space included; of a CAN FD frame, what is at the nominal bit rate."""
    data_bits: int = 0
    data_bitrate: int = SECOND
    """The data phase of a CAN FD frame, and its bit rate."""
    period_ns: int
    """Least time between two releases."""
    jitter_ns: int = 0
    """By how much a release may be late against an even period."""
    release: Release = Release.SPORADIC
    deadline_ns: int = 0
    """Time after which it is too late; 0: with the next release."""

    def ns(self, bitrate: int) -> int:
        """Return the time of the longest frame, rounded up, ns."""
        return frame_ns(self.bits, bitrate) + frame_ns(self.data_bits, self.data_bitrate)

    @property
    def limit_ns(self) -> int:
        """The deadline, or the period."""
        return self.deadline_ns or self.period_ns


ERROR_FRAME_BITS = 31
"""Longest error frame: flags of all nodes, delimiter and interframe space (Tindell and Burns)."""


class ErrorModel(NamedTuple):
    """Errors on the bus, at most: ``burst`` of them at any time, and ``per_s`` beyond."""

    per_s: float = 0.0
    burst: int = 0

    def lost_ns(self, window: int, longest_ns: int, bitrate: int) -> int:
        """Return the time that errors take in a window, ns; each costs a frame of ``longest_ns``."""
        n = self.burst + math.ceil(window * self.per_s / SECOND)
        return n * (frame_ns(ERROR_FRAME_BITS, bitrate) + longest_ns)


NO_ERRORS = ErrorModel()


def load(messages: Sequence[Message], bitrate: int) -> float:
    """Return the share of the bus that the messages take at worst, 0 to 1 and more."""
    return sum(m.ns(bitrate) / m.period_ns for m in messages)


def frame_ns(bits: int, bitrate: int) -> int:
    """Return the time of a number of bits, rounded up, ns."""
    return -(-bits * SECOND // bitrate)


def response_times(
    messages: Sequence[Message], bitrate: int, errors: ErrorModel = NO_ERRORS
) -> dict[int, int | None]:
    """Return the worst time from release to the end of the frame by COB-ID, ns; None when unbounded."""
    flow = _Flow(messages, bitrate)
    return {m.cob_id: _response(flow, n, errors) for n, m in enumerate(flow.messages)}


def cycle_times(
    messages: Sequence[Message],
    bitrate: int,
    *,
    response_ns: int = 0,
    compute_ns: int = 0,
    errors: ErrorModel = NO_ERRORS,
) -> dict[int, int | None]:
    """Return the worst time by COB-ID, ns; of SYNC, readings and what is published from queueing the SYNC.

    ``response_ns`` passes from the end of the SYNC to the readings, ``compute_ns`` from those to contacts.
    Sporadic messages count from their own release. Should a cycle not end within its period, those of its
    messages that do not are analysed as if the cycles were independent; None when unbounded.
    """
    ordered = sorted(messages, key=lambda m: m.cob_id)
    (sync,), readings, published, sporadic = (
        [m for m in ordered if m.release is release]
        for release in (Release.SYNC, Release.READING, Release.PUBLISHED, Release.SPORADIC)
    )
    cost = {m.cob_id: m.ns(bitrate) for m in ordered}
    longest_ns = max(cost.values())

    def above(some: Sequence[Message], m: Message) -> int:
        """Return the time of those of higher priority than m, ns."""
        return sum(cost[k.cob_id] for k in some if k.cob_id < m.cob_id)

    def blocking(m: Message, some: Sequence[Message] = sporadic) -> int:
        """Return the longest frame of lower priority than m, ns.

        Readings and contacts of this cycle are not there yet, and those of the last are gone: that is checked
        in the end.
        """
        return max((cost[k.cob_id] for k in some if k.cob_id > m.cob_id), default=0)

    def end(m: Message, base: int, level: Message) -> int | None:
        """Return the end of m: base, itself, and the sporadic messages above ``level``, ns."""
        flow = _Flow([k for k in sporadic if k.cob_id < level.cob_id], bitrate)

        def grow(w: int) -> int:
            return base + flow.arrivals(w) + errors.lost_ns(w, longest_ns, bitrate)

        w = _fixpoint(grow, base, 4 * sync.period_ns)
        return None if w is None else w + cost[m.cob_id]

    def until_released(m: Message) -> int:
        """Return the time of all that comes before readings compete, sporadic messages aside, ns."""
        again = max(blocking(m), blocking(m, readings)) if response_ns else 0
        return blocking(sync) + cost[sync.cob_id] + response_ns + again

    times = {m.cob_id: end(m, until_released(m) + above(readings, m), m) for m in readings}
    last = readings[-1] if readings else None
    for m in published:
        times[m.cob_id] = None
        if last:
            base = until_released(last) + above(readings, last) + cost[last.cob_id] + compute_ns
            # a frame of any lower priority may begin while the master computes
            base += blocking(m) + above(published, m)
            times[m.cob_id] = end(m, base, max(m, last, key=lambda k: k.cob_id))
    overrun = any(t is None or t > sync.period_ns for t in times.values())

    # What a cycle releases looks like a periodic message with jitter to those that are not part of the cycle.
    sync_ns = end(sync, blocking(sync), sync) or sync.period_ns
    last_ns = max((times[m.cob_id] or sync.period_ns for m in readings), default=sync_ns)
    jitters = {
        Release.READING: sync_ns + response_ns,
        Release.PUBLISHED: min(last_ns, sync.period_ns) + compute_ns,
    }
    flow = _Flow([replace(m, jitter_ns=jitters.get(m.release, m.jitter_ns)) for m in ordered], bitrate)
    for n, m in enumerate(flow.messages):
        if overrun or m.release not in jitters:
            times[m.cob_id] = _response(flow, n, errors)
    return times


def _response(flow: _Flow, n: int, errors: ErrorModel) -> int | None:
    """Return the worst response time of the n-th message of a flow, over all instances of its busy period."""
    m, c, longest = flow.messages[n], flow.ns[n], max(flow.ns[: n + 1])
    blocking = max(flow.ns[n + 1 :], default=0)
    if flow.loads[n] >= 1.0:
        return None
    limit = 1000 * max(k.period_ns + k.jitter_ns for k in flow.messages)

    def lost_ns(window: int) -> int:
        return errors.lost_ns(window, longest, flow.bitrate)

    def grow_busy(t: int) -> int:
        return blocking + flow.arrivals(t - flow.bit_ns, n + 1) + lost_ns(t)

    busy = _fixpoint(grow_busy, c, limit)
    if busy is None:
        return None
    worst = 0
    w: int | None = blocking
    for q in range(-(-(busy + m.jitter_ns) // m.period_ns)):
        base = blocking + q * c

        def grow(w: int, base: int = base) -> int:
            return base + flow.arrivals(w, n) + lost_ns(w + c)

        w = _fixpoint(grow, max(w or 0, base), limit)
        if w is None:
            return None
        worst = max(worst, m.jitter_ns + w - q * m.period_ns + c)
    return worst


class _Flow:
    """Messages by priority, and what they can put on a bus: exact in 64 bits for windows of years."""

    def __init__(self, messages: Sequence[Message], bitrate: int) -> None:
        self.messages = sorted(messages, key=lambda m: m.cob_id)
        self.bitrate, self.bit_ns = bitrate, frame_ns(1, bitrate)
        self.ns = [m.ns(bitrate) for m in self.messages]
        self._period = np.array([m.period_ns for m in self.messages], np.int64)
        self._late = np.array([m.jitter_ns for m in self.messages]) + self.bit_ns
        self._ns = np.array(self.ns)
        self.loads = np.cumsum(self._ns / self._period)
        """Share of the bus that the first messages take at worst."""

    def arrivals(self, window: int, n: int | None = None) -> int:
        """Return the time of all frames of the first n messages that can be released within a window, ns.

        What is released up to one bit after its end counts: it wins the arbitration that follows.
        """
        return int((-(-(window + self._late[:n]) // self._period[:n])) @ self._ns[:n])


def _fixpoint(grow: Callable[[int], int], begin: int, limit: int) -> int | None:
    """Return the least w >= begin with w = grow(w), None when there is none up to ``limit``."""
    w = begin
    while (after := grow(w)) != w:
        if after > limit:
            return None
        w = after
    return w
