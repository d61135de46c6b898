"""The boards on one bus: CANopen devices behind one port that show the readings of a source.

Frames reach only the devices that listen to them, and a device is woken only when it asked for it. What
effects of a scene do to the traffic is done here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from heapq import heappop, heappush

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import NEVER, Step
from skinbus.can.event import Event
from skinbus.can.frame import REMOTE_ID, RTR, Frame
from skinbus.model import Arm
from skinbus.node import Device
from skinbus.node.storage import MemoryStorage
from skinbus.objects.cia import READINGS, SYNC_ID
from skinbus.sim.effect import FrameStep, at

Counts = npt.NDArray[np.int32]


Source = Callable[[int], Counts]
"""What boards of one bus read: the newest counts (n_tactels,), left-adjusted, at a time (ns).

It is called at each SYNC. An array that was returned before is not looked at again.
"""


class Boards:
    """A core, made of cores: the patches of an arm with one bus.

    Args:
        arm: the patches; all are on this bus.
        ods: their object dictionaries.
        source: what they read.
        boot_s: (n_patches,) time from power-on to the first sign of life, s.
        clock_ppm: (n_patches,) by how much each board's clock is fast.
        frame_steps: what effects do to the traffic.
        scene_s: returns scene time, for these effects.
    """

    def __init__(
        self,
        arm: Arm,
        ods: Sequence[ObjectDictionary],
        source: Source,
        *,
        boot_s: npt.NDArray[np.float64],
        clock_ppm: npt.NDArray[np.float64],
        frame_steps: Sequence[FrameStep] = (),
        scene_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self.frame_steps = tuple(frame_steps)
        self._source, self._scene_s = source, scene_s
        self._held = Held()
        self.devices = [
            Device(od, placed.node_id, storage=MemoryStorage())
            for od, placed in zip(ods, arm.patches, strict=True)
        ]
        self._shows = [
            (device.image_view(index, 1, placed.patch.n_tactels), arm.tactels_of(p))
            for p, (device, placed) in enumerate(zip(self.devices, arm.patches, strict=True))
            for index in READINGS
            if index in device.layout.indices
        ]
        """Where the TPDOs of each board find its readings, and which tactels those are."""
        self._shown: Counts | None = None
        self._boot_s = boot_s
        # a clock that is fast by ppm shows more time than has passed
        self._speed: list[float] = (1.0 + 1e-6 * clock_ppm).tolist() if clock_ppm.any() else []
        self._wake_ns = [NEVER] * len(self.devices)
        self._wakes: list[tuple[int, int]] = []
        self._listeners: dict[int, list[int]] = {}
        self._heard: list[frozenset[int]] = [frozenset()] * len(self.devices)
        self.cob_ids: frozenset[int] = frozenset({SYNC_ID})
        """Identifiers that any device listens to."""
        self._node_ids: list[int] = arm.node_id.tolist()
        self._powered = False
        self._due_ns = 0
        """When there is more to do than to let late frames go, ns."""

    def show(self, counts: Counts) -> None:
        """Put counts (n_tactels,) where the TPDOs find them."""
        if counts is not self._shown:
            self._shown = counts
            for view, tactels in self._shows:
                view[:] = counts[tactels]

    def step(self, now_ns: int, frames: Sequence[Frame] = ()) -> Step:
        """Take the frames received up to ``now_ns``, do what is due, and say when to call again."""
        if now_ns < self._due_ns and not frames:
            # nothing but late frames
            return Step(self._held.release(now_ns), (), min(self._due_ns, self._held.wake_ns))
        out: list[Frame] = []
        events: list[Event] = []
        if not self._powered:
            self._power_on(now_ns, out, events)
        for frame in frames:
            if frame.can_id == SYNC_ID and not frame.flags:
                self.show(self._source(now_ns))
            if self.frame_steps:
                self._hear_spoilt(now_ns, [frame], out, events)
                continue
            frame_id = frame.can_id | REMOTE_ID if frame.flags == RTR else frame.can_id
            for i in self._listeners.get(frame_id, ()):
                self._step(i, now_ns, (frame,), out, events)
        while self._wakes and self._wakes[0][0] <= now_ns:
            wake_ns, i = heappop(self._wakes)
            if self._wake_ns[i] == wake_ns:
                self._wake_ns[i] = NEVER
                self._step(i, now_ns, (), out, events)
        self._due_ns = self._wakes[0][0] if self._wakes else NEVER
        if not self.frame_steps:
            return Step(out, events, self._due_ns)
        for effect in self.frame_steps:
            effect.say(now_ns, self._scene_s(), out)
            self._due_ns = min(self._due_ns, effect.wake_ns)
        out = self._held.release(now_ns) + self._held.sort_out(now_ns, out)
        return Step(out, events, min(self._due_ns, self._held.wake_ns))

    def wake(self, i: int, wake_ns: int) -> None:
        """Have device i stepped at a time, and not before unless it receives something."""
        if wake_ns != self._wake_ns[i]:
            self._wake_ns[i] = wake_ns
            if wake_ns < NEVER:
                heappush(self._wakes, (wake_ns, i))
                self._due_ns = min(self._due_ns, wake_ns)

    def _power_on(self, now_ns: int, out: list[Frame], events: list[Event]) -> None:
        self._powered = True
        for i, boot_s in enumerate(self._boot_s):
            self.wake(i, now_ns + round(1e9 * boot_s))
        self._hear_spoilt(now_ns, [], out, events)

    def _hear_spoilt(self, now_ns: int, frames: list[Frame], out: list[Frame], events: list[Event]) -> None:
        """Pass what effects leave of some frames to the devices."""
        t_s = self._scene_s()
        deaf: set[int] = set()
        for effect in self.frame_steps:
            effect.receive(now_ns, t_s, frames)
            deaf |= effect.deaf
        for frame in frames:
            for i in self._listeners.get(frame.can_id, ()):
                if self._node_ids[i] not in deaf:
                    self._step(i, now_ns, (frame,), out, events)

    def _step(
        self, i: int, now_ns: int, frames: Sequence[Frame], out: list[Frame], events: list[Event]
    ) -> None:
        device = self.devices[i]
        local_ns = now_ns
        if self._speed:
            local_ns = round(now_ns * self._speed[i])
            frames = [at(frame, local_ns) for frame in frames]
        step = device.step(local_ns, frames)
        # a board's frames leave now, whatever its own clock says
        out += [at(frame, now_ns) for frame in step.frames] if self._speed else step.frames
        events += step.events
        wake_ns = step.wake_ns
        if self._speed and wake_ns < NEVER:
            wake_ns = round(wake_ns / self._speed[i]) + 1  # not before its own clock shows the time
        self.wake(i, wake_ns)
        if device.cob_ids is not self._heard[i]:
            self._heard[i] = device.cob_ids
            self._listen()

    def _listen(self) -> None:
        """Compile which device receives what; called when a device changes what it listens to."""
        listeners: dict[int, list[int]] = {}
        for i, cob_ids in enumerate(self._heard):
            for cob_id in cob_ids:
                listeners.setdefault(cob_id, []).append(i)
        self._listeners = listeners
        # SYNC drives the scene even while no device listens to it
        self.cob_ids = frozenset(listeners) | {SYNC_ID}


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
