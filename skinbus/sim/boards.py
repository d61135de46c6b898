"""What effects of a scene do to its patches as CANopen devices: to their clocks, and to their traffic."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from heapq import heappop, heappush

from skinbus.can.core import NEVER, Core, Output, Step
from skinbus.can.frame import CobIds, Frame, Frames
from skinbus.node import Device, PatchHost
from skinbus.sim.effect import FrameStep, at


class DriftingDevice(Device):
    """A device whose clock is fast by ``ppm``: it shows more time than has passed."""

    ppm = 0.0

    def step(self, now_ns: int, frames: Frames = ()) -> Step:
        """As that of the device, at the time that its own clock shows."""
        speed = 1.0 + 1e-6 * self.ppm
        local_ns = round(now_ns * speed)
        out, events, wake_ns = super().step(local_ns, [at(frame, local_ns) for frame in frames])
        if wake_ns < NEVER:
            wake_ns = round(wake_ns / speed) + 1  # not before its own clock shows the time
        # a board's frames leave now, whatever its own clock says
        return Step([at(frame, now_ns) for frame in out], events, wake_ns)


class SpoiltTraffic(Core):
    """The patches of one bus, with what effects do to their traffic.

    Args:
        host: the patches.
        effects: what is done, in the order of physics.
        scene_s: returns scene time.
    """

    def __init__(self, host: PatchHost, effects: Sequence[FrameStep], scene_s: Callable[[], float]) -> None:
        self.effects = tuple(effects)
        self._host, self._scene_s = host, scene_s
        self._held = Held()
        self._is_on = False
        self._due_ns = 0
        """When an effect has something to say, ns."""

    @property
    def cob_ids(self) -> CobIds:
        """Identifiers that any device listens to."""
        return self._host.cob_ids

    def step(self, now_ns: int, frames: Frames = ()) -> Step:
        """Take the frames received up to ``now_ns``, do what is due, and say when to call again."""
        if frames or now_ns >= min(self._due_ns, self._host.wake_ns):
            out, events = self._hear(now_ns, frames)
            self._due_ns = NEVER
            for effect in self.effects:
                effect.say(now_ns, self._scene_s(), out)
                self._due_ns = min(self._due_ns, effect.wake_ns)
        else:  # nothing but late frames
            out, events = [], []
        out = self._held.release(now_ns) + self._held.sort_out(now_ns, out)
        return Step(out, events, min(self._due_ns, self._host.wake_ns, self._held.wake_ns))

    def _hear(self, now_ns: int, frames: Frames) -> Output:
        """Pass what effects leave of each frame to the devices; return what they say."""
        parts = [[frame] for frame in frames]
        if not self._is_on:
            self._is_on = True
            parts.insert(0, [])
        steps = []
        t_s = self._scene_s()
        for part in parts:
            for effect in self.effects:
                effect.receive(now_ns, t_s, part)
            self._host.deaf = frozenset().union(*(effect.deaf for effect in self.effects))
            steps.append(self._host.step(now_ns, part))
        steps.append(self._host.step(now_ns))
        return [frame for step in steps for frame in step.frames], [e for step in steps for e in step.events]


class Held:
    """A heap of late frames; frames of one identifier leave in the order in which they came."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Frame]] = []
        self._last_ns: dict[int, int] = {}
        self._n = 0

    @property
    def wake_ns(self) -> int:
        """When the next frame is due, ns."""
        return self._heap[0][0] if self._heap else NEVER

    def release(self, now_ns: int) -> list[Frame]:
        """Return what is due of what is held."""
        due = []
        while self._heap and self._heap[0][0] <= now_ns:
            due.append(heappop(self._heap)[2])
        return due

    def sort_out(self, now_ns: int, frames: list[Frame]) -> list[Frame]:
        """Return what of ``frames`` leaves now, by the time of each, and hold the rest."""
        due = []
        last_ns = self._last_ns
        for frame in frames:
            can_id, _, t_ns, _, _ = frame
            if t_ns <= now_ns and last_ns.get(can_id, 0) <= now_ns:
                due.append(frame)
                continue
            last_ns[can_id] = due_ns = max(t_ns, last_ns.get(can_id, 0))
            self._n += 1
            heappush(self._heap, (due_ns, self._n, frame))
        return due
