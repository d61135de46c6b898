"""Drains: a patch of which late frames may be under way is stopped until it is silent, and started again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import Frame
from skinbus.node.nmt import nmt_frame
from skinbus.objects import cia

GRACE_NS: Final = 100_000_000
"""A heartbeat that contradicts a command so soon after was under way before: two full buses long."""

Mask = npt.NDArray[np.bool_]


class Drains:
    """Gives the commands; separates heartbeats that follow from them from those of a patch that fell back."""

    def __init__(self, node_ids: Sequence[int]) -> None:
        self._node_ids = node_ids
        self._is_stopped = np.zeros(len(node_ids), np.bool_)
        self._commanded_ns = np.full(len(node_ids), -GRACE_NS)

    def command(self, now_ns: int, stop: Mask, start: Mask) -> list[Frame]:
        """Return the commands that stop some patches (n_patches,) and start others."""
        self._is_stopped = self._is_stopped & ~start | stop
        self._commanded_ns[stop | start] = now_ns
        commands = (cia.NmtCommand.PRE_OPERATIONAL, stop), (cia.NmtCommand.START, start)
        return [
            nmt_frame(command, self._node_ids[p])
            for command, patches in commands
            for p in np.flatnonzero(patches).tolist()
        ]

    def end(self, p: int) -> None:
        """Note that patch p was booted and started."""
        self._is_stopped[p] = False

    def explains(self, now_ns: int, p: int, state: int) -> bool:
        """Return whether a heartbeat of patch p with this state follows from the commands."""
        is_stopped = bool(self._is_stopped[p]) and state == cia.NmtState.PRE_OPERATIONAL
        return is_stopped or now_ns - int(self._commanded_ns[p]) < GRACE_NS
