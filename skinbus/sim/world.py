"""The world: all patches of a scene as CANopen devices, behind one port of each bus.

On SYNC the layer is sampled once for all patches, the counts go to the process images of the devices, and
the devices send what their PDO engines say. Where patches are on several buses, the SYNCs of one cycle come a
little apart: they all get the same sample.

Scene time follows the SYNC: sample k is taken at k / rate_hz, with the rate of the arm, whatever the clock of
the bus does. So a scene gives the same readings on the virtual clock, on a virtual bus in real time, and on a
real interface. A world that ``follows="clock"`` takes scene time from the bus, counted from its first step,
and samples by itself at rate_hz, as boards with a free-running converter do: SYNC then sends what was
sampled last, and event-driven TPDOs need no SYNC at all.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Final, Literal

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event
from skinbus.can.frame import Frame
from skinbus.config.system import ods_of
from skinbus.node import Device
from skinbus.objects.profile import SampleStatus
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
        follows: what scene time follows; see the module.
        repeat: whether the scene begins anew when it is over.
        buses: numbers of the buses whose patches there are; frames are numbered by their place in it.
    """

    def __init__(
        self,
        scene: Scene,
        ods: Sequence[ObjectDictionary] | None = None,
        *,
        follows: Literal["sync", "clock"] = "sync",
        repeat: bool = False,
        buses: Sequence[int] | None = None,
    ) -> None:
        arm = scene.arm
        ods = ods_of(arm) if ods is None else ods
        if len(ods) != arm.n_patches:
            raise ValueError(f"{len(ods)} object dictionaries for {arm.n_patches} patches")
        self.scene = scene
        self.sampler = Sampler(scene)
        self._clock = SceneClock(
            1.0 / arm.bus.rate_hz, follows=follows, repeat_s=scene.duration_s if repeat else inf
        )
        boot_s = stream(scene.seed, "boot").uniform(*BOOT_S, arm.n_patches)
        on_buses = list(range(len(arm.buses)) if buses is None else buses)
        patches = [arm.patches_on(bus) for bus in on_buses]
        self.boards = [
            Boards(
                part := arm.part(bus),
                ods[mine],
                _Sampled(self, k),
                boot_s=boot_s[mine],
                clock_ppm=self.sampler.clock_ppm[mine],
                frame_steps=[
                    effect.bind(part, stream(scene.seed, effect.name, bus))
                    for effect in scene.effects
                    if effect.stage is Stage.FRAMES
                ],
                scene_s=lambda: self._clock.now_s,
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
        self._sampled_ns = 0
        self._next_sample_ns = NEVER
        self._by_sync = follows == "sync"
        if not self._by_sync:
            for device in self.devices:
                device.sample_status = SampleStatus.OLD
        self._powered = False
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

    @property
    def n_samples(self) -> int:
        """Samples taken so far."""
        return self._clock.n_samples

    def scene_time(self, t_ns: int) -> float:
        """Return the scene time at a bus time (s); counting SYNCs, that of the latest one up to then."""
        return self._clock.at(t_ns)

    def truth(self, t_ns: int) -> Touches:
        """Return the touches of the sample that was on its way at a bus time."""
        return self.scene.touches_at(self.scene_time(t_ns))

    def step(self, now_ns: int, frames: Sequence[Frame] = ()) -> Step:
        """Take the frames received up to ``now_ns``, do what is due, and say when to call again."""
        if not self._powered:
            self._power_on(now_ns)
        if now_ns >= self._next_sample_ns:
            self._sample_freely(now_ns)
        if len(self.boards) == 1:
            step = self.boards[0].step(now_ns, frames)
            return step if self._by_sync else step._replace(wake_ns=min(step.wake_ns, self._next_sample_ns))
        out: list[Frame] = []
        events: list[Event] = []
        wake_ns = self._next_sample_ns
        for k, boards in enumerate(self.boards):
            step = boards.step(now_ns, [frame for frame in frames if frame.bus == k])
            out += [on_bus(k, frame) for frame in step.frames]
            events += [replace(event, bus=k) for event in step.events]
            wake_ns = min(wake_ns, step.wake_ns)
        return Step(out, events, wake_ns)

    def _power_on(self, now_ns: int) -> None:
        self._powered = True
        self._clock.begin(now_ns)
        if not self._by_sync:
            self._next_sample_ns = now_ns + self._period_ns

    def newest(self, k: int, now_ns: int) -> tuple[Counts, int]:
        """Return the readings of bus k, which has a SYNC now, and the time of their sample (ns).

        A sample is due, unless another bus had the SYNC of this cycle before.
        """
        is_due = self._has_sample[k] or now_ns - self._sampled_ns > self._period_ns // 2
        if self._by_sync and is_due:
            self._sample(now_ns)
        self._has_sample[k] = True
        return self._counts[k], self._sampled_ns

    def _sample(self, now_ns: int) -> None:
        """Take a sample of all patches."""
        self._sampled_ns = now_ns
        t_s = self._clock.tick(now_ns)
        if self.on_sample is not None:
            self.on_sample(now_ns, t_s)
        self._has_sample = [False] * len(self.boards)
        if self.sampler.sample(t_s):
            self._counts = [self.sampler.counts[tactels] for tactels in self._tactels]

    def _sample_freely(self, now_ns: int) -> None:
        """Take a sample without SYNC, and let the devices look whether it is worth an event."""
        missed = (now_ns - self._next_sample_ns) // self._period_ns
        self._next_sample_ns += (missed + 1) * self._period_ns
        self._sample(now_ns)
        for boards, counts in zip(self.boards, self._counts, strict=True):
            boards.look(counts)


@dataclass(slots=True)
class _Sampled:
    """The scene as the source of the boards on one bus."""

    world: World
    k: int

    def newest(self, now_ns: int) -> tuple[Counts, int]:
        return self.world.newest(self.k, now_ns)


class SceneClock:
    """Maps bus time (ns) to scene time (s): by counting SYNCs, or by the bus clock itself."""

    def __init__(self, period_s: float, *, follows: str, repeat_s: float = inf) -> None:
        """``repeat_s``: the scene begins anew after so long."""
        self._period_s = period_s
        self._repeat_s = repeat_s
        self._by_sync = follows == "sync"
        self._begin_ns: int | None = None
        self._times: deque[int] = deque(maxlen=_HISTORY)
        self.n_samples = 0
        self.now_s = 0.0
        """Scene time of the last sample, s."""

    def begin(self, now_ns: int) -> None:
        """The bus clock at scene time 0, unless SYNCs are counted."""
        if self._begin_ns is None:
            self._begin_ns = now_ns

    def tick(self, now_ns: int) -> float:
        """A SYNC came: return the scene time of its sample (s)."""
        self._times.append(now_ns)
        self.n_samples += 1
        count_s = (self.n_samples - 1) * self._period_s % self._repeat_s
        self.now_s = count_s if self._by_sync else self.at(now_ns)
        return self.now_s

    def at(self, t_ns: int) -> float:
        """Return the scene time at a bus time (s); of the latest SYNC up to then if SYNCs are counted."""
        if not self._by_sync:
            return 0.0 if self._begin_ns is None else (t_ns - self._begin_ns) / 1e9 % self._repeat_s
        index = bisect_right(self._times, t_ns)
        return max(0, self.n_samples - len(self._times) + index - 1) * self._period_s % self._repeat_s
