"""Many conversations side by side: each a script that talks to its node through an SDO client of its own.

A script is a generator: it yields SDO requests and is sent the replies, so that it reads like the
conversation it is, while many of them are held at once without threads.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.node.sdo_client import DEFAULT_TIMEOUT_NS, SdoClient


@dataclass(frozen=True, slots=True)
class Request:
    """An SDO transfer that a script asks for: a download when there is data, else an upload."""

    index: int
    sub: int
    data: bytes | None = None


class Reply(NamedTuple):
    """What came of it: data, or the abort code (0 for none)."""

    data: bytes = b""
    abort: int = 0


T = TypeVar("T")
"""What a script comes to."""

Script = Generator[Request, Reply, T]


@dataclass(slots=True)
class _Talk(Generic[T]):
    script: Script[T]
    client: SdoClient
    has_answered: bool = False


class SdoSessions(Generic[T]):
    """The conversations under way, by a number of the caller's choice: the patch, or the node-ID."""

    def __init__(self, timeout_ns: int = DEFAULT_TIMEOUT_NS) -> None:
        self._sessions: dict[int, _Talk[T]] = {}
        self._timeout_ns = timeout_ns

    def __contains__(self, key: int) -> bool:
        return key in self._sessions

    def __len__(self) -> int:
        return len(self._sessions)

    @property
    def n_answering(self) -> int:
        """Those whose node is there."""
        return sum(talk.has_answered for talk in self._sessions.values())

    @property
    def wake_ns(self) -> int:
        """Time of the next time-out (ns)."""
        return min((talk.client.wake_ns for talk in self._sessions.values()), default=NEVER)

    def begin(
        self, now_ns: int, key: int, node_id: int, script: Script[T], *, is_there: bool = False
    ) -> list[Frame]:
        """Begin a conversation, dropping one under way with the same key; return the first request.

        ``is_there`` says that the node has been heard of already.
        """
        client = SdoClient(node_id, timeout_ns=self._timeout_ns)
        talk = self._sessions[key] = _Talk(script, client, is_there)
        return _ask(now_ns, talk, next(script))

    def step(self, now_ns: int, answers: dict[int, list[Frame]]) -> tuple[list[Frame], list[tuple[int, T]]]:
        """Take SDO answers by key; return the next requests, and what those that have ended came to."""
        out: list[Frame] = []
        ended: list[tuple[int, T]] = []
        due = [key for key, talk in self._sessions.items() if talk.client.wake_ns <= now_ns]
        for key in {*answers, *due}:
            talk = self._sessions.get(key)
            if talk is not None:
                try:
                    _advance(now_ns, talk, answers.get(key, ()), out)
                except StopIteration as end:
                    del self._sessions[key]
                    ended.append((key, end.value))
        return out, ended


def _advance(now_ns: int, talk: _Talk[T], frames: Sequence[Frame], out: list[Frame]) -> None:
    """Feed one talk; StopIteration when its script has ended."""
    talk.has_answered |= bool(frames)
    out += talk.client.step(now_ns, frames)
    result = talk.client.result
    if result is None:
        return
    out += _ask(now_ns, talk, talk.script.send(Reply(result.data, result.abort or 0)))


def _ask(now_ns: int, talk: _Talk[T], request: Request) -> list[Frame]:
    if request.data is None:
        talk.client.start_read(request.index, request.sub)
    else:
        talk.client.start_write(request.index, request.sub, request.data)
    return talk.client.step(now_ns)
