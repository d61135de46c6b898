"""Finds a babbling node: one identifier that takes more than half of a busy bus, received by us or not.

The interface counts its frames; when they are many, a socket of its own listens to everything for a moment,
and what comes first is looked at. That costs 0.1 ms four times a second on a busy bus, else nothing.
"""

from __future__ import annotations

import socket
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from skinbus.bus.socketcan_batch import CANFD_MTU, EFF_FLAG, EFF_MASK, ERR_FLAG, SFF_MASK, filters
from skinbus.can.clock import Clock
from skinbus.can.event import Event, EventKind

COUNT_EVERY_NS = 5_000_000
"""Time between looks at the interface's counter, 20 us each: a loss is reported in its own cycle."""


def statistic(file: Path) -> int | None:
    """Return a counter of an interface (/sys/class/net/NAME/statistics/...); None if it cannot be read."""
    try:
        return int(file.read_bytes())
    except (OSError, ValueError):
        return None


class BacklogDrops:
    """Counts received frames that were lost before they came to any socket, since it was made.

    A kernel that is too busy to hand frames on queues a thousand of them (net.core.netdev_max_backlog) and
    drops the rest; so does a driver without memory. No socket reports these: they are the interface's
    ``rx_dropped``. Where that cannot be read, nothing is counted.
    """

    def __init__(self, file: Path) -> None:
        self.n = 0
        self._next_ns = 0
        self._file = file
        self._before = statistic(file) or 0

    def look(self, now_ns: int | None = None) -> None:
        """Bring ``n`` up to date; with a time only if the last look was some time before it."""
        if now_ns is not None:
            if now_ns < self._next_ns:
                return
            self._next_ns = now_ns + COUNT_EVERY_NS
        value = statistic(self._file)
        if value is not None:
            self.n = max(value - self._before, self.n)


BUSY_HZ = 500
"""Frames a second from which the bus is listened to: half of what fills a bus of 125 kbit/s."""

SHARE = 0.5
"""Of the frames; an SDO client and its server, the busiest pair of a sound bus, have no more than this each.

A flood of requests that is answered one by one is such a pair, and not reported.
"""

LOOK_EVERY_NS = 250_000_000
SAMPLE_NS = 20_000_000
"""Listening lasts that long: ten frames of a bus that is just busy."""

N_LEAST = 8
"""Frames in which a share means something."""

N_LOOKS = 2
"""Looks in a row that must agree on who babbles, or that nobody does any more: half a second."""

SAMPLE_BUFFER = 16_384
"""Bytes of socket buffer: some 40 frames, the kernel's book-keeping included."""


class BabbleWatch:
    """Checks at intervals whether a node babbles, and reports when that begins and ends."""

    def __init__(self, sock: socket.socket, packets: Path, clock: Clock) -> None:
        """``sock`` receives nothing yet and is taken over; ``packets`` counts the frames of the interface."""
        self.babbler: int | None = None
        """Identifier under which somebody babbles."""
        self._sock = sock
        self._packets = packets
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SAMPLE_BUFFER)
        self._listening = False
        self._rate_hz = 0.0
        self._before = statistic(packets) or 0
        self._before_ns = clock.now_ns()
        self._next_ns = self._before_ns + LOOK_EVERY_NS
        self._suspect: int | None = None
        self._n_agreed = 0

    def news(self, now_ns: int) -> list[Event]:
        """Look if it is time; return events.

        Raises:
            OSError: the interface is down or gone.
        """
        if now_ns < self._next_ns:
            return []
        if self._listening:
            self._listen(False)
            return self._judge(now_ns, *loudest(list(self._heard())))
        n = statistic(self._packets)
        if n is None:
            self._next_ns = now_ns + LOOK_EVERY_NS
            return []
        self._rate_hz = (n - self._before) * 1e9 / (now_ns - self._before_ns)
        self._before, self._before_ns = n, now_ns
        if self._rate_hz < BUSY_HZ:
            return self._judge(now_ns, None, 0.0)
        self._listen(True)
        self._next_ns = now_ns + SAMPLE_NS
        return []

    def close(self) -> None:
        """Let go of the socket."""
        self._sock.close()

    def _listen(self, on: bool) -> None:
        self._listening = on
        wanted = filters(None if on else ())
        self._sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, wanted)

    def _heard(self) -> Iterator[int]:
        """Yield the identifiers of frames that came while it listened."""
        with suppress(BlockingIOError):
            while frame := self._sock.recv(CANFD_MTU):
                can_id = int.from_bytes(frame[:4], "little")
                yield can_id & (EFF_MASK if can_id & (EFF_FLAG | ERR_FLAG) else SFF_MASK)

    def _judge(self, now_ns: int, can_id: int | None, share: float) -> list[Event]:
        self._next_ns = now_ns + LOOK_EVERY_NS
        self._n_agreed = self._n_agreed + 1 if can_id == self._suspect else 1
        self._suspect = can_id
        if self._n_agreed < N_LOOKS or can_id == self.babbler:
            return []
        events = []
        if self.babbler is not None:
            events.append(_event(now_ns, EventKind.BABBLING_END, self.babbler, 0))
        self.babbler = can_id
        if can_id is not None:
            events.append(_event(now_ns, EventKind.BABBLING, can_id, round(share * self._rate_hz)))
        return events


def loudest(ids: Sequence[int]) -> tuple[int | None, float]:
    """The identifier of more than ``SHARE`` of these frames and its share; None if there is none."""
    for can_id, n in Counter(ids).most_common(1) if len(ids) >= N_LEAST else ():
        if n > SHARE * len(ids):
            return can_id, n / len(ids)
    return None, 0.0


def _event(now_ns: int, kind: EventKind, can_id: int, rate_hz: int) -> Event:
    detail = f"0x{can_id:03X}" + (f", {rate_hz} frames a second" if rate_hz else "")
    return Event(now_ns, kind, detail=detail, cob_id=can_id, count=rate_hz)
