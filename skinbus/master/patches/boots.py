"""Boots of patches side by side: their provisioning, and when those that are good are started."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Script, Sessions, Timeouts
from skinbus.master.patches.expected_nodes import ExpectedNode
from skinbus.master.patches.provisioning import BOOT, Answering, Provision, Provisioned, provision

HOLD_NS: Final = 20_000_000
"""No patch is started so soon after the first boot-up message of another: on the wire these give way to SDO,
so those of many boards that start together come one by one; 20 frame times at 125 kbit/s."""

Ended = Provisioned | Answering | int | None
"""What a session returned: of a boot, of a question for the boards of a node-ID, or for errors."""


class Boots:
    """Sessions by patch.

    Readings of started patches would slow the boots of the others down: all that are there are started
    together. A patch is waited for once: one that reboots again and again delays no other.
    """

    def __init__(self, plans: Sequence[ExpectedNode], timeouts: Timeouts | None) -> None:
        self._plans = tuple(plans)
        self._sessions: Sessions[Ended] = Sessions(timeouts)
        self._ready: list[int] = []
        self._has_booted = np.zeros(len(plans), np.bool_)
        self._is_restored = np.zeros(len(plans), np.bool_)  # to its defaults, and not accepted since
        self._hold_until = 0

    def __contains__(self, p: int) -> bool:
        return p in self._sessions

    @property
    def wake_ns(self) -> int:
        """Time of the next thing to do (ns)."""
        hold = self._hold_until if self._ready and not self._sessions.n_answering else NEVER
        return min(self._sessions.wake_ns, hold)

    def clear(self) -> None:
        """Drop all, as when the master is reset."""
        self._sessions.clear()
        self._ready.clear()
        self._has_booted[:] = False

    def drop(self, p: int) -> None:
        """Drop the boot of patch p."""
        self._sessions.drop(p)
        if p in self._ready:
            self._ready.remove(p)

    def begin(self, now_ns: int, p: int, *, has_sent_boot_up: bool = False) -> list[Frame]:
        """Begin, or begin anew, the boot of patch p; return its first frames."""
        is_first = has_sent_boot_up and not self._has_booted[p]
        if is_first:
            self._has_booted[p] = True
            self._hold_until = now_ns + HOLD_NS
        self.drop(p)
        plan = self._plans[p]
        script = provision(plan, BOOT, is_restored=bool(self._is_restored[p]))
        return self._sessions.begin(now_ns, p, plan.node_id, script, is_there=is_first)

    def ask(self, now_ns: int, p: int, script: Script[Ended]) -> list[Frame]:
        """Begin another script with patch p; return its first frames."""
        return self._sessions.begin(now_ns, p, self._plans[p].node_id, script)

    def step(
        self, now_ns: int, answers: Mapping[int, Sequence[Frame]]
    ) -> tuple[list[Frame], list[tuple[int, Ended]]]:
        """Take SDO answers by patch; return frames to send, and what has ended."""
        if not answers and now_ns < self._sessions.wake_ns:
            return [], []
        out, ended = self._sessions.step(now_ns, answers)
        for p, result in ended:
            if isinstance(result, Provisioned):
                if result.outcome.is_good or result.outcome is Provision.RESTORED:
                    self._is_restored[p] = not result.outcome.is_good
                if result.outcome.is_good:
                    self._ready.append(p)
        return out, ended

    def take_ready(self, now_ns: int) -> list[int]:
        """Return the patches that are to be started now."""
        if not self._ready or now_ns < self._hold_until or self._sessions.n_answering:
            return []
        ready, self._ready = self._ready, []
        return ready
