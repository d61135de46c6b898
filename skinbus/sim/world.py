"""The world: all patches of a scene as CANopen devices, behind one port of each bus.

On SYNC the layer is sampled once for all patches, the counts go to the process images of the devices, and
the devices send what their PDO engines say. Where patches are on several buses, the SYNCs of one cycle come a
little apart: they all get the same sample.

Scene time follows the SYNC: sample k is taken at k / rate_hz, with the rate of the arm, whatever the clock of
the bus does. So a scene gives the same readings on the virtual clock, on a virtual bus in real time, and on a
real interface.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from typing import Final

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event
from skinbus.can.frame import Frame
from skinbus.config.system import ods_of
from skinbus.node import Device
from skinbus.sim.boards import Boards, Counts
from skinbus.sim.effect import Stage, on_bus, stream
from skinbus.sim.sampler import Sampler
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touches

_HISTORY: Final = 4096
BOOT_S: Final = (0.005, 0.050)
"""Boards start up between these times after power-on, s: microcontrollers do not wake in step."""


class World(Core):
    """The patches of a scene: a core on as many buses as the arm has.

    Args:
        scene: what happens.
        ods: object dictionaries, one per patch of the scene's arm; from its EDS files when None.
        repeat: whether the scene begins anew when it is over.
        buses: numbers of the buses whose patches there are; frames are numbered by their place in it.
    """

    def __init__(
        self,
        scene: Scene,
        ods: Sequence[ObjectDictionary] | None = None,
        *,
        repeat: bool = False,
        buses: Sequence[int] | None = None,
    ) -> None:
        arm = scene.arm
        ods = ods_of(arm) if ods is None else ods
        if len(ods) != arm.n_patches:
            raise ValueError(f"{len(ods)} object dictionaries for {arm.n_patches} patches")
        self.scene = scene
        self.sampler = Sampler(scene)
        self._repeat_s = scene.duration_s if repeat else inf
        self._times: deque[int] = deque(maxlen=_HISTORY)
        """Of the last samples, ns."""
        self.n_samples = 0
        """Samples taken so far."""
        boot_s = stream(scene.seed, "boot").uniform(*BOOT_S, arm.n_patches)
        on_buses = list(range(len(arm.buses)) if buses is None else buses)
        patches = [arm.patches_on(bus) for bus in on_buses]
        self.boards = [
            Boards(
                part := arm.part(bus),
                ods[mine],
                partial(self._newest, k),
                boot_s=boot_s[mine],
                clock_ppm=self.sampler.clock_ppm[mine],
                frame_steps=[
                    effect.bind(part, stream(scene.seed, effect.name, bus))
                    for effect in scene.effects
                    if effect.stage is Stage.FRAMES
                ],
                scene_s=lambda: self._scene_s(self.n_samples - 1),
            )
            for k, (bus, mine) in enumerate(zip(on_buses, patches, strict=True))
        ]
        """By bus."""
        self._tactels = [slice(arm.patch_start[mine.start], arm.patch_start[mine.stop]) for mine in patches]
        self.devices: list[Device] = [device for boards in self.boards for device in boards.devices]
        self._counts = [self.sampler.counts[tactels] for tactels in self._tactels]
        self._has_sample = [True] * len(self.boards)
        for boards, counts in zip(self.boards, self._counts, strict=True):
            boards.show(counts)
        self._period_ns = round(1e9 / arm.bus.rate_hz)
        self.on_sample: Callable[[int, float], None] | None = None
        """Called with bus time (ns) and scene time (s) when a sample is taken."""

    @property
    def n_buses(self) -> int:
        """On how many buses there are patches."""
        return len(self.boards)

    @property
    def cob_ids(self) -> frozenset[int]:
        """Identifiers that any device on the first bus listens to."""
        return self.boards[0].cob_ids

    def cob_ids_on(self, bus: int) -> frozenset[int]:
        """Identifiers that any device on a bus listens to."""
        return self.boards[bus].cob_ids

    def scene_time(self, t_ns: int) -> float:
        """Return the scene time at a bus time (s): that of the latest SYNC up to then."""
        index = bisect_right(self._times, t_ns)
        return self._scene_s(self.n_samples - len(self._times) + index - 1)

    def _scene_s(self, sample: int) -> float:
        return max(0, sample) / self.scene.arm.bus.rate_hz % self._repeat_s

    def truth(self, t_ns: int) -> Touches:
        """Return the touches of the sample that was on its way at a bus time."""
        return self.scene.touches_at(self.scene_time(t_ns))

    def step(self, now_ns: int, frames: Sequence[Frame] = ()) -> Step:
        """Take the frames received up to ``now_ns``, do what is due, and say when to call again."""
        if len(self.boards) == 1:
            return self.boards[0].step(now_ns, frames)
        out: list[Frame] = []
        events: list[Event] = []
        wake_ns = NEVER
        for k, boards in enumerate(self.boards):
            step = boards.step(now_ns, [frame for frame in frames if frame.bus == k])
            out += [on_bus(k, frame) for frame in step.frames]
            events += [replace(event, bus=k) for event in step.events]
            wake_ns = min(wake_ns, step.wake_ns)
        return Step(out, events, wake_ns)

    def _newest(self, k: int, now_ns: int) -> Counts:
        """Return the readings of bus k, which has a SYNC now.

        A sample is due, unless another bus had the SYNC of this cycle before.
        """
        if self._has_sample[k] or now_ns - self._times[-1] > self._period_ns // 2:
            self._times.append(now_ns)
            self.n_samples += 1
            t_s = self._scene_s(self.n_samples - 1)
            if self.on_sample is not None:
                self.on_sample(now_ns, t_s)
            self._has_sample = [False] * len(self.boards)
            if self.sampler.sample(t_s):
                self._counts = [self.sampler.counts[tactels] for tactels in self._tactels]
        self._has_sample[k] = True
        return self._counts[k]
