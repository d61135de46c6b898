"""Configuration of the patches of an arm: compared, downloaded, read back and stored, all side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Sessions, Timeouts
from skinbus.master.other_master import OtherMaster
from skinbus.master.patches.provisioning import (
    COMPARE,
    CONFIGURE,
    ExpectedNode,
    Provision,
    Provisioned,
    final_values,
    provision,
)
from skinbus.node.nmt import nmt_frame
from skinbus.objects import cia

TRIES: Final = 3
"""Times a patch is asked whether it is there: at 0.3 s each, longer than a board takes to start."""

LISTEN_NS: Final = 300_000_000
"""Before anything is sent, the bus is listened to for so long: SYNC means that a master is at work."""

REBOOT_NS: Final = 2_000_000_000
"""Longest time from the reset of a patch to its boot-up message."""


class Configurer(Core):
    """A core that configures all patches of ``plans`` and then asks its host to stop.

    ``results`` fills up by node-ID; ``progress`` is the share of the work that is done. Where another master
    is at work nothing is sent.
    """

    cob_ids: frozenset[int] | None = frozenset()

    def __init__(
        self,
        plans: Sequence[ExpectedNode],
        *,
        dry_run: bool = False,
        timeouts: Timeouts | None = None,
        on_result: Callable[[int, Provisioned], object] | None = None,
    ) -> None:
        self.results: dict[int, Provisioned] = {}
        self.other_master = OtherMaster()
        self._plans = {plan.node_id: plan for plan in plans}
        self._task = COMPARE if dry_run else CONFIGURE
        self._on_result = on_result
        self._sessions: Sessions[Provisioned] = Sessions(timeouts)
        self._tries = dict.fromkeys(self._plans, TRIES)
        self._rebooting: dict[int, int] = {}
        self._n_answers = dict.fromkeys(self._plans, 0)
        self._answer = {cia.SDO_SERVER_BASE + node_id: node_id for node_id in self._plans}
        self._boot_up = {cia.HEARTBEAT_BASE + node_id: node_id for node_id in self._plans}
        self.cob_ids = frozenset(self._answer) | frozenset(self._boot_up) | OtherMaster.cob_ids
        self._begin_at: int | None = None
        self._started = False

    @property
    def progress(self) -> float:
        """Share of the work that is done, 0 to 1; an estimate."""
        done = sum(
            1.0 if node_id in self.results else min(0.99, self._n_answers[node_id] / _n_answers(plan))
            for node_id, plan in self._plans.items()
        )
        return done / len(self._plans) if self._plans else 1.0

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        out: list[Frame] = []
        if self._begin_at is None:
            self._begin_at = now_ns + LISTEN_NS
        if not self._started:
            events = self.other_master.step(now_ns, frames)
            if self.other_master.is_present:
                return Step((), [*events, Event(t_ns=now_ns, kind=EventKind.STOP)], NEVER)
            if now_ns < self._begin_at:
                return Step((), (), self._begin_at)
            self._started = True
            for node_id in self._plans:
                if self._task.writes:  # readings must not change their meaning under a listener
                    out.append(nmt_frame(cia.NmtCommand.PRE_OPERATIONAL, node_id))
                self._begin(now_ns, node_id, out)
        answers: dict[int, list[Frame]] = {}
        for frame in frames:
            if (answering := self._answer.get(frame.can_id)) is not None:
                answers.setdefault(answering, []).append(frame)
                self._n_answers[answering] += 1
            elif self._boot_up.get(frame.can_id) in self._rebooting and frame.data == b"\0":
                self._rebooting[self._boot_up[frame.can_id]] = now_ns
        requests, ended = self._sessions.step(now_ns, answers)
        out += requests
        for node_id, result in ended:
            self._conclude(now_ns, node_id, result, out)
        for node_id in [n for n, until_ns in self._rebooting.items() if until_ns <= now_ns]:
            del self._rebooting[node_id]  # it has booted, or sends no boot-up message
            self._begin(now_ns, node_id, out, is_restored=True)
        done = len(self.results) == len(self._plans)
        wake_ns = min(self._sessions.wake_ns, min(self._rebooting.values(), default=NEVER))
        return Step(out, [Event(t_ns=now_ns, kind=EventKind.STOP)] if done else (), wake_ns)

    def _begin(self, now_ns: int, node_id: int, out: list[Frame], *, is_restored: bool = False) -> None:
        plan = self._plans[node_id]
        script = provision(plan, self._task, is_restored=is_restored)
        out += self._sessions.begin(now_ns, node_id, node_id, script)

    def _conclude(self, now_ns: int, node_id: int, result: Provisioned, out: list[Frame]) -> None:
        if result.outcome is Provision.RESTORED:
            out.append(nmt_frame(cia.NmtCommand.RESET_NODE, node_id))
            self._rebooting[node_id] = now_ns + REBOOT_NS
            return
        if result.outcome is Provision.ABSENT and not result.changes:
            self._tries[node_id] -= 1
            if self._tries[node_id] > 0:
                self._begin(now_ns, node_id, out)
                return
        self.results[node_id] = result
        if self._on_result:
            self._on_result(node_id, result)


def _n_answers(plan: ExpectedNode) -> int:
    """Return about how many SDO answers a patch gives until it is configured."""
    return 10 + len(plan.configuration.writes) + 2 * len(final_values(plan.configuration.writes))
