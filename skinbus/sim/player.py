"""A world played without a bus, as fast as it goes: boot, start, one SYNC after another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from skinbus.can.frame import Frame
from skinbus.objects.cia import HEARTBEAT_BASE, NMT_COMMAND_ID, SYNC_ID, NmtCommand
from skinbus.sim.world import World

BOOT_NS: Final = 100_000_000
"""Time that boards have to start, ns; see ``world.BOOT_S``."""
_BOOT_UP: Final = b"\x00"


class Player:
    """Plays the part of the master, who starts every board that boots, and of a wire that takes no time."""

    def __init__(self, world: World) -> None:
        """Power the world on and let its boards boot."""
        self._world = world
        self._period_ns = round(1e9 / world.scene.arm.bus.rate_hz)
        self._now_ns = 0
        self._wake_ns = 0
        self._n_syncs = 0
        self._booted: list[tuple[int, int]] = []  # bus, node-ID
        self._run_to(BOOT_NS)

    def cycle(self) -> Sequence[Frame]:
        """Send one SYNC and return everything that is said until the next is due."""
        for bus, node_id in self._booted:
            self._say(Frame(NMT_COMMAND_ID, bytes([NmtCommand.START, node_id]), bus=bus))
        self._booted.clear()
        self._n_syncs += 1
        overflow = self._world.scene.arm.bus.sync_counter
        counter = bytes([(self._n_syncs - 1) % overflow + 1]) if overflow else b""
        frames = list(self._say(*(Frame(SYNC_ID, counter, bus=k) for k in range(self._world.n_buses))))
        frames += self._run_to(self._now_ns + self._period_ns)
        return frames

    def _run_to(self, until_ns: int) -> list[Frame]:
        frames: list[Frame] = []
        while self._wake_ns < until_ns:
            self._now_ns = max(self._wake_ns, self._now_ns + 1)
            frames += self._say()
        self._now_ns = until_ns
        return frames

    def _say(self, *frames: Frame) -> Sequence[Frame]:
        step = self._world.step(self._now_ns, frames)
        self._wake_ns = step.wake_ns
        for frame in step.frames:
            if frame.data == _BOOT_UP and frame.can_id > HEARTBEAT_BASE:
                self._booted.append((frame.bus, frame.can_id - HEARTBEAT_BASE))
        return step.frames
