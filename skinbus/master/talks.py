"""Many boots side by side: each a script that talks to its patch through an SDO client of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skinbus.bus.core import NEVER
from skinbus.bus.frame import Frame
from skinbus.master.boot import Boot, Reply, Request, Verdict
from skinbus.node.sdo_client import SdoClient


@dataclass(slots=True)
class _Talk:
    script: Boot
    client: SdoClient
    has_answered: bool = False


class Talks:
    """The boots under way, by patch."""

    def __init__(self) -> None:
        self._talks: dict[int, _Talk] = {}

    def __contains__(self, patch: int) -> bool:
        return patch in self._talks

    @property
    def n_answering(self) -> int:
        """Boots of patches that are there."""
        return sum(talk.has_answered for talk in self._talks.values())

    @property
    def wake_ns(self) -> int:
        """Time of the next time-out (ns)."""
        return min((talk.client.wake_ns for talk in self._talks.values()), default=NEVER)

    def begin(self, now_ns: int, patch: int, node_id: int, script: Boot) -> list[Frame]:
        """Begin the boot of a patch, dropping one under way; return the first request."""
        talk = self._talks[patch] = _Talk(script, SdoClient(node_id))
        return _ask(now_ns, talk, next(script))

    def step(
        self, now_ns: int, answers: dict[int, list[Frame]]
    ) -> tuple[list[Frame], list[tuple[int, Verdict]]]:
        """Take SDO answers by patch; return the next requests and the boots that have ended."""
        out: list[Frame] = []
        ended: list[tuple[int, Verdict]] = []
        due = [p for p, talk in self._talks.items() if talk.client.wake_ns <= now_ns]
        for patch in {*answers, *due}:
            talk = self._talks.get(patch)
            if talk is not None:
                verdict = _advance(now_ns, talk, answers.get(patch, ()), out)
                if verdict is not None:
                    del self._talks[patch]
                    ended.append((patch, verdict))
        return out, ended


def _advance(now_ns: int, talk: _Talk, frames: Sequence[Frame], out: list[Frame]) -> Verdict | None:
    """Feed one talk; return the verdict when its script has come to one."""
    talk.has_answered |= bool(frames)
    out += talk.client.step(now_ns, frames)
    result = talk.client.result
    if result is None:
        return None
    try:
        request = talk.script.send(Reply(result.data, result.abort or 0))
    except StopIteration as end:
        verdict: Verdict = end.value
        return verdict
    out += _ask(now_ns, talk, request)
    return None


def _ask(now_ns: int, talk: _Talk, request: Request) -> list[Frame]:
    if request.data is None:
        talk.client.start_read(request.index, request.sub)
    else:
        talk.client.start_write(request.index, request.sub, request.data)
    return talk.client.step(now_ns)
