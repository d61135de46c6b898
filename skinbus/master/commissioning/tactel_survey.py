"""Survey of tactels: patches that have implausible or suspect ones, by the objects of a running master."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Reply, Request, Script, Sessions
from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import (
    MASTER_NODE_ID,
    PATCH_FAULTY_COUNT,
    PATCH_SUSPECT,
)


class Surveyed(NamedTuple):
    """Numbers of tactels of one patch."""

    n_implausible: int
    n_suspect: int
    """Touched ever since power came: a touch, or a zero that is far off."""


class TactelSurvey(Core):
    """A core that asks the master on its bus and then asks its host to stop; it changes nothing."""

    cob_ids: frozenset[int] | None = frozenset()

    def __init__(self, node_ids: Sequence[int], master_id: int = MASTER_NODE_ID) -> None:
        self.patches: dict[int, Surveyed] = {}
        """By node-ID; none of those that the master does not answer for."""
        self.cob_ids = frozenset({cia.SDO_SERVER_BASE + master_id})
        self._master_id = master_id
        self._script = _ask(node_ids, master_id)
        self._sessions: Sessions[dict[int, Surveyed]] = Sessions()
        self._is_begun = False

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        out: list[Frame] = []
        if not self._is_begun:
            self._is_begun = True
            out += self._sessions.begin(now_ns, 0, self._master_id, self._script)
        requests, ended = self._sessions.step(now_ns, {0: list(frames)} if frames else {})
        for _, self.patches in ended:
            return Step(out, [Event(t_ns=now_ns, kind=EventKind.STOP)], NEVER)
        return Step([*out, *requests], (), self._sessions.wake_ns)


def _ask(node_ids: Sequence[int], master_id: int) -> Script[dict[int, Surveyed]]:
    """Read the two counts of each patch; the first time-out ends it."""
    od = load_eds("skin-master", master_id)
    objects = [od[name.object].index for name in (PATCH_FAULTY_COUNT, PATCH_SUSPECT)]
    patches: dict[int, Surveyed] = {}
    for node_id in node_ids:
        counts = []
        for index in objects:
            reply: Reply = yield Request(index, node_id)
            if reply.is_silent:
                return patches
            counts.append(int.from_bytes(reply.data, "little"))
        patches[node_id] = Surveyed(*counts)
    return patches
