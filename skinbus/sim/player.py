"""A world played without a bus, as fast as it goes: boot, start, one SYNC after another."""

from __future__ import annotations

from skinbus.can.frame import Frame, Frames
from skinbus.objects.cia import HEARTBEAT_BASE, NMT_COMMAND_ID, SYNC_ID, NmtCommand
from skinbus.sim.world import World

BOOT_NS = 100_000_000
"""Time that boards have to start, ns; see ``world.BOOT_S``."""


class Player:
    """Plays the part of the master, who starts every board that boots, and of a wire that takes no time."""

    def __init__(self, world: World) -> None:
        """Power the world on and let its boards boot."""
        self._world = world
        self._period_ns = round(1e9 / world.scene.arm.bus.rate_hz)
        self._now_ns = self._wake_ns = self._n_syncs = 0
        self.run_to(BOOT_NS)

    def cycle(self) -> Frames:
        """Send one SYNC and return everything that is said until the next is due."""
        self._n_syncs += 1
        overflow = self._world.scene.arm.bus.sync_counter
        counter = bytes([(self._n_syncs - 1) % overflow + 1]) if overflow else b""
        frames = self._say([Frame(SYNC_ID, counter, bus=k) for k in range(self._world.n_buses)])
        return frames + self.run_to(self._now_ns + self._period_ns)

    def run_to(self, until_ns: int) -> list[Frame]:
        """Let time pass without a SYNC; return what is said."""
        frames: list[Frame] = []
        while self._wake_ns < until_ns:
            self._now_ns = max(self._wake_ns, self._now_ns + 1)
            frames += self._say([])
        self._now_ns = until_ns
        return frames

    def _say(self, frames: Frames) -> list[Frame]:
        step = self._world.step(self._now_ns, frames)
        self._wake_ns = step.wake_ns
        said = list(step.frames)
        booted = [f for f in said if f.data == b"\x00" and f.can_id > HEARTBEAT_BASE]
        for frame in booted:
            command = bytes([NmtCommand.START, frame.can_id - HEARTBEAT_BASE])
            said += self._say([Frame(NMT_COMMAND_ID, command, bus=frame.bus)])
        return said
