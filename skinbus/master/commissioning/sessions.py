"""Sessions with nodes side by side: scripts that yield SDO transfers, or listen, and get what came.

A script is a generator, so that it reads like the protocol it follows, while many of them run at once without
threads.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, TypeVar

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import CobIds, Frame, Frames
from skinbus.master.other_master import OtherMaster
from skinbus.model import Arm, BusSettings
from skinbus.node.context import NS_PER_MS
from skinbus.node.sdo_client import DEFAULT_TIMEOUT_NS, SdoClient
from skinbus.node.sdo_server import FRAME_LENGTH, HEAD
from skinbus.objects import cia

INITIATE_ANSWERS = (2, 3)
"""Command specifiers of answers that name their object: to the request of an upload and of a download."""


SLOW = (cia.STORE_PARAMETERS, cia.RESTORE_DEFAULTS, cia.PROGRAM_DATA, cia.PROGRAM_CONTROL)
"""Objects whose writes take the time of flash."""


class Timeouts(NamedTuple):
    """How long an answer is awaited (ns)."""

    sdo_ns: int = DEFAULT_TIMEOUT_NS
    store_ns: int = BusSettings().store_timeout_ms * NS_PER_MS
    """To a write of what takes the time of flash."""


class Request(NamedTuple):
    """An SDO transfer: a download when there is data, else an upload."""

    index: int  # type: ignore[assignment]  # hides a method of tuples, which is not used here
    sub: int
    data: bytes | None = None


class Reply(NamedTuple):
    """What an SDO transfer came to: data, or the abort code (0 for none)."""

    data: bytes = b""
    abort: int = 0
    n_surplus: int = 0
    """Answers in this session that came a second time: is there another node with this node-ID?"""

    @property
    def is_silent(self) -> bool:
        """Whether nothing was answered in time."""
        return self.abort == cia.AbortCode.TIMEOUT


class Listen(NamedTuple):
    """Frames to send, and all that come for a time, or until one that ``until`` accepts and what follows it.

    ``settle_ns``: for so long after that one others are awaited; they look the same, and one that comes late
    would be taken for the answer to the next request. With 0 it is the last.
    """

    ns: int
    until: Callable[[Frame], bool] | None = None
    send: tuple[Frame, ...] = ()
    settle_ns: int = 0


def timeouts_of(arm: Arm) -> Timeouts:
    """Return the time-outs of the arm file; one thread serves all buses, so that an answer may wait."""
    each = arm.bus.sdo_timeout_ms, arm.bus.store_timeout_ms
    return Timeouts(*(len(arm.buses) * ms * NS_PER_MS for ms in each))


T = TypeVar("T")
"""What a script returns."""

Script = Generator[Request | Listen, Any, T]
"""A script is sent the ``Reply`` to each request, and the frames that were listened to."""


class SdoTransfer(SdoClient):
    """A transfer under way."""

    def __init__(self, request: Request, node_id: int, timeouts: Timeouts) -> None:
        is_slow = request.data is not None and request.index in SLOW
        super().__init__(node_id, timeout_ns=timeouts.store_ns if is_slow else timeouts.sdo_ns)
        self.key = HEAD.pack(0, request.index, request.sub)[1:]
        """By which its answers are known: index and sub-index."""
        if request.data is None:
            self.start_read(request.index, request.sub)
        else:
            self.start_write(request.index, request.sub, request.data)

    @property
    def reply(self) -> Reply | None:
        """What came of it; None while it goes on."""
        # A plain number: ``in`` of a range counts up to an enum member, for seconds.
        return None if self.result is None else Reply(self.result.data, int(self.result.abort or 0))


class ListenUnderWay:
    """Frames are collected."""

    def __init__(self, listen: Listen) -> None:
        self._listen = listen
        self._received: list[Frame] = []
        self.wake_ns = 0
        self.reply: list[Frame] | None = None

    def step(self, now_ns: int, frames: Frames) -> list[Frame]:
        """Take frames; return those to send."""
        if not self.wake_ns:
            self.wake_ns = now_ns + self._listen.ns
            return list(self._listen.send)
        for frame in frames:
            self._received.append(frame._replace(t_ns=frame.t_ns or now_ns))
            if self._listen.until is not None and self._listen.until(frame):
                self.wake_ns = min(self.wake_ns, now_ns + self._listen.settle_ns)
                if not self._listen.settle_ns:
                    break
        if now_ns >= self.wake_ns:
            self.reply = self._received
        return []


UnderWay = SdoTransfer | ListenUnderWay


@dataclass(slots=True)
class _Session(Generic[T]):
    script: Generator[Any, Any, T]
    node_id: int
    under_way: UnderWay
    has_answered: bool = False
    answered: set[bytes] = field(default_factory=set)
    """Keys of the transfers that have been answered."""
    n_surplus: int = 0


class Sessions(dict[int, _Session[T]]):
    """The sessions under way, by a number of the caller's choice: the patch, or the node-ID."""

    def __init__(self, timeouts: Timeouts | None = None) -> None:
        super().__init__()
        self._timeouts = timeouts or Timeouts()

    @property
    def n_answering(self) -> int:
        """Those whose node has answered."""
        return sum(session.has_answered for session in self.values())

    @property
    def wake_ns(self) -> int:
        """Time of the next time-out (ns)."""
        return min((session.under_way.wake_ns for session in self.values()), default=NEVER)

    def begin(self, now_ns: int, key: int, node_id: int, script: Generator[Any, Any, T]) -> list[Frame]:
        """Begin a script, dropping one under way with the same key; return its first frames."""
        self[key] = session = _Session(script, node_id, self._open(next(script), node_id))
        return session.under_way.step(now_ns, ())

    def step(self, now_ns: int, answers: Mapping[int, Frames]) -> tuple[list[Frame], list[tuple[int, T]]]:
        """Take frames by key; return the next frames, and what the scripts that have ended returned."""
        out: list[Frame] = []
        ended: list[tuple[int, T]] = []
        for key, session in list(self.items()):
            if key in answers or session.under_way.wake_ns <= now_ns:
                try:
                    out += self._advance(now_ns, session, answers.get(key, ()))
                except StopIteration as end:
                    del self[key]
                    ended.append((key, end.value))
        return out, ended

    def _advance(self, now_ns: int, session: _Session[T], frames: Frames) -> list[Frame]:
        """Feed one session; return what it sends. StopIteration when its script has ended."""
        session.has_answered |= bool(frames)
        under_way, keys = session.under_way, _keys(frames)
        current = under_way.key if isinstance(under_way, SdoTransfer) else b""
        session.n_surplus += sum(key != current and key in session.answered for key in keys)
        out = under_way.step(now_ns, frames)
        reply = under_way.reply
        if reply is None:
            return out
        if isinstance(reply, Reply):
            if not reply.is_silent:
                session.n_surplus += max(0, keys.count(current) - 1)
                session.answered.add(current)
            reply = reply._replace(n_surplus=session.n_surplus)
        session.under_way = self._open(session.script.send(reply), session.node_id)
        return out + session.under_way.step(now_ns, ())

    def _open(self, request: Request | Listen, node_id: int) -> UnderWay:
        if isinstance(request, Request):
            return SdoTransfer(request, node_id, self._timeouts)
        return ListenUnderWay(request)


def _keys(frames: Frames) -> list[bytes]:
    """Return the objects that SDO answers name, as the keys of transfers."""
    return [
        frame.data[1:4]
        for frame in frames
        if len(frame.data) == FRAME_LENGTH and frame.data[0] >> 5 in INITIATE_ANSWERS
    ]


class ScriptCore(Core):
    """A core that goes through one script, with one node or with all, and then asks its host to stop."""

    cob_ids: CobIds | None = None

    def __init__(self, script: Script[None], node_id: int = 0, timeouts: Timeouts | None = None) -> None:
        self._script, self._node_id = script, node_id
        self._session: Sessions[None] = Sessions(timeouts)
        self._has_begun = False

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        if self._has_begun:
            out, _ = self._session.step(now_ns, {0: frames})
        else:
            self._has_begun = True
            out = self._session.begin(now_ns, 0, self._node_id, self._script)
        stop = () if self._session else [Event(now_ns, EventKind.STOP)]
        return Step(out, stop, self._session.wake_ns)


class NodesCore(Core, Generic[T]):
    """A core that runs a script with each of some nodes, side by side, and then asks its host to stop.

    Args:
        node_ids: of the nodes.
        listens_ns: before anything is sent; while another master is at work it sends nothing at all then.
        lasts_ns: least time from the first request to the end.
    """

    cob_ids: CobIds | None = None

    def __init__(
        self,
        node_ids: Iterable[int],
        timeouts: Timeouts | None = None,
        *,
        listens_ns: int = 0,
        lasts_ns: int = 0,
    ) -> None:
        self.other_master = OtherMaster()
        self._node_ids = tuple(node_ids)
        self.results: dict[int, T] = {}
        """What scripts have returned, by node-ID."""
        self._sessions: Sessions[T] = Sessions(timeouts)
        self._listens_ns, self._lasts_ns = listens_ns, lasts_ns
        self._begin_ns: int | None = None
        self._end_ns = NEVER
        bases = (cia.SDO_SERVER_BASE, cia.HEARTBEAT_BASE)
        self._node_of = {base + node_id: node_id for node_id in self._node_ids for base in bases}
        self.cob_ids = frozenset(self._node_of) | OtherMaster.cob_ids

    @abstractmethod
    def _script(self, node_id: int) -> Script[T]:
        """Return the script of a node."""

    def _first(self) -> list[Frame]:
        """Return what is sent before all scripts."""
        return []

    def _hear(self, frame: Frame) -> None:
        """Take any frame."""

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        events = self.other_master.step(now_ns, frames)
        if self._begin_ns is None:
            self._begin_ns = now_ns + self._listens_ns
        out: list[Frame] = []
        if self._end_ns == NEVER:
            if self._listens_ns and self.other_master.is_present:
                return Step((), [*events, Event(now_ns, EventKind.STOP)], NEVER)
            if now_ns < self._begin_ns:
                return Step((), (), self._begin_ns)
            self._end_ns = now_ns + self._lasts_ns
            out += self._first()
            for node_id in self._node_ids:
                out += self._sessions.begin(now_ns, node_id, node_id, self._script(node_id))
        by_node: dict[int, list[Frame]] = {}
        for frame in frames:
            self._hear(frame)
            if (sender := self._node_of.get(frame.can_id)) is not None:
                by_node.setdefault(sender, []).append(frame)
        requests, ended = self._sessions.step(now_ns, by_node)
        self.results |= ended
        wake_ns = self._sessions.wake_ns if self._sessions else max(self._end_ns, now_ns)
        is_over = not self._sessions and now_ns >= self._end_ns
        stop = [Event(now_ns, EventKind.STOP)] * is_over
        return Step(out + requests, stop, NEVER if is_over else wake_ns)
