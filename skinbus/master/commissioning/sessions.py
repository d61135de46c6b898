"""Sessions with nodes side by side: scripts that yield SDO transfers or LSS exchanges and get the replies.

A script is a generator, so that it reads like the protocol it follows, while many of them run at once without
threads.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Generic, NamedTuple, TypeVar

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.node.sdo_client import DEFAULT_TIMEOUT_NS, SdoClient
from skinbus.objects import cia

LSS_TIMEOUT_NS: Final = 20_000_000
"""What most LSS masters give a slave to answer; fastscan waits so long for every one bit."""

SETTLE_SHARE: Final = 4
"""After a first answer to an exchange others are awaited for this fraction of the time-out: they look the
same, and one that comes late would be taken for the answer to the next request."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeouts:
    """How long an answer is awaited (ns)."""

    sdo_ns: int = DEFAULT_TIMEOUT_NS
    lss_ns: int = LSS_TIMEOUT_NS


@dataclass(frozen=True, slots=True)
class Request:
    """An SDO transfer: a download when there is data, else an upload."""

    index: int
    sub: int
    data: bytes | None = None


class Reply(NamedTuple):
    """What an SDO transfer came to: data, or the abort code (0 for none)."""

    data: bytes = b""
    abort: int = 0

    @property
    def is_silent(self) -> bool:
        """Whether nothing was answered in time."""
        return self.abort == cia.AbortCode.TIMEOUT


@dataclass(frozen=True, slots=True)
class Exchange:
    """Frames to send, and the answers to wait for: those that begin with ``first`` on ``can_id``.

    With ``awaits_all`` the first answer is not the end: more may come. Without ``can_id`` it is a pause.
    """

    send: tuple[Frame, ...]
    can_id: int | None = cia.LSS_SLAVE_ID
    first: int = 0
    timeout_factor: float = 1.0
    awaits_all: bool = False


T = TypeVar("T")
"""What a script returns."""

Script = Generator[Request, Reply, T]
LssScript = Generator[Exchange, list[bytes], T]
"""A script is sent the answers to each exchange, none when time ran out."""


class SdoTransfer:
    """A transfer under way."""

    def __init__(self, request: Request, node_id: int, timeouts: Timeouts) -> None:
        self._client = SdoClient(node_id, timeout_ns=timeouts.sdo_ns)
        if request.data is None:
            self._client.start_read(request.index, request.sub)
        else:
            self._client.start_write(request.index, request.sub, request.data)

    @property
    def wake_ns(self) -> int:
        """Time of the time-out (ns)."""
        return self._client.wake_ns

    @property
    def reply(self) -> Reply | None:
        """What came of it; None while it goes on."""
        result = self._client.result
        return None if result is None else Reply(result.data, result.abort or 0)

    def step(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Take frames; return those to send."""
        return self._client.step(now_ns, frames)


class ExchangeUnderWay:
    """An exchange whose answers are awaited."""

    def __init__(self, exchange: Exchange, timeouts: Timeouts) -> None:
        self._exchange = exchange
        self._timeout_ns = timeouts.lss_ns
        self._answers: list[bytes] = []
        self._is_sent = False
        self.wake_ns = 0
        self.reply: list[bytes] | None = None
        """The answers, when all are there or time has run out."""

    def step(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Take frames; return those to send."""
        exchange = self._exchange
        if not self._is_sent:
            self._is_sent = True
            self.wake_ns = now_ns + round(exchange.timeout_factor * self._timeout_ns)
            return list(exchange.send)
        for frame in frames:
            if frame.can_id == exchange.can_id and frame.data[:1] == bytes([exchange.first]):
                if not self._answers and exchange.awaits_all:
                    self.wake_ns = min(self.wake_ns, now_ns + self._timeout_ns // SETTLE_SHARE)
                self._answers.append(frame.data)
        if now_ns >= self.wake_ns or (self._answers and not exchange.awaits_all):
            self.reply = self._answers
            self.wake_ns = NEVER
        return []


@dataclass(slots=True)
class _Session(Generic[T]):
    script: Generator[Any, Any, T]
    node_id: int
    under_way: SdoTransfer | ExchangeUnderWay
    has_answered: bool = False


class Sessions(Generic[T]):
    """The sessions under way, by a number of the caller's choice: the patch, or the node-ID."""

    def __init__(self, timeouts: Timeouts | None = None) -> None:
        self._sessions: dict[int, _Session[T]] = {}
        self._timeouts = timeouts or Timeouts()

    def __contains__(self, key: int) -> bool:
        return key in self._sessions

    def __len__(self) -> int:
        return len(self._sessions)

    @property
    def n_answering(self) -> int:
        """Those whose node has answered."""
        return sum(session.has_answered for session in self._sessions.values())

    @property
    def wake_ns(self) -> int:
        """Time of the next time-out (ns)."""
        return min((session.under_way.wake_ns for session in self._sessions.values()), default=NEVER)

    def begin(
        self, now_ns: int, key: int, node_id: int, script: Generator[Any, Any, T], *, is_there: bool = False
    ) -> list[Frame]:
        """Begin a script, dropping one under way with the same key; return its first frames.

        ``is_there``: the node has sent something already.
        """
        under_way = self._open(next(script), node_id)
        self._sessions[key] = _Session(script, node_id, under_way, is_there)
        return under_way.step(now_ns, ())

    def clear(self) -> None:
        """Drop all."""
        self._sessions.clear()

    def step(
        self, now_ns: int, answers: Mapping[int, Sequence[Frame]]
    ) -> tuple[list[Frame], list[tuple[int, T]]]:
        """Take frames by key; return the next frames, and what the scripts that have ended returned."""
        out: list[Frame] = []
        ended: list[tuple[int, T]] = []
        due = [key for key, session in self._sessions.items() if session.under_way.wake_ns <= now_ns]
        for key in {*answers, *due}:
            session = self._sessions.get(key)
            if session is not None:
                try:
                    self._advance(now_ns, session, answers.get(key, ()), out)
                except StopIteration as end:
                    del self._sessions[key]
                    ended.append((key, end.value))
        return out, ended

    def _advance(self, now_ns: int, session: _Session[T], frames: Sequence[Frame], out: list[Frame]) -> None:
        """Feed one session; StopIteration when its script has ended."""
        session.has_answered |= bool(frames)
        out += session.under_way.step(now_ns, frames)
        reply = session.under_way.reply
        if reply is not None:
            session.under_way = self._open(session.script.send(reply), session.node_id)
            out += session.under_way.step(now_ns, ())

    def _open(self, request: Request | Exchange, node_id: int) -> SdoTransfer | ExchangeUnderWay:
        if isinstance(request, Request):
            return SdoTransfer(request, node_id, self._timeouts)
        return ExchangeUnderWay(request, self._timeouts)
