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

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.arrays import Ints32
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event
from skinbus.can.frame import CobIds, Frame, Frames
from skinbus.config.system import ods_of
from skinbus.node import Device, PatchHost, Sample
from skinbus.node.host import SCAN_NS
from skinbus.objects.cia import SYNC_ID
from skinbus.objects.profile import GUARD_PERIOD_US, has, index_of
from skinbus.sim.boards import DriftingDevice, SpoiltTraffic
from skinbus.sim.effect import Stage, on_bus, stream
from skinbus.sim.sampler import Sampler
from skinbus.sim.scene import Scene

_HISTORY = 4096
BOOT_S = (0.005, 0.050)
"""Boards start up between these times after power-on, s: microcontrollers do not wake in step."""


class World(Core):
    """The patches of a scene: a core on as many buses as the arm has.

    Args:
        scene: what happens.
        ods: object dictionaries, one per patch of the scene's arm; from its EDS files when None.
        repeat: whether the scene begins anew when it is over.
        buses: numbers of the buses whose patches there are; frames are numbered by their place in it.
        scan_ns: between two samples of patches that run freely or guard.
    """

    def __init__(
        self,
        scene: Scene,
        ods: Sequence[ObjectDictionary] | None = None,
        *,
        repeat: bool = False,
        buses: Sequence[int] | None = None,
        scan_ns: int = SCAN_NS,
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
        self._sampled_ns = 0
        self.n_samples = 0
        """Samples taken so far."""
        boot_s = stream(scene.seed, "boot").uniform(*BOOT_S, arm.n_patches)
        on_buses = list(range(len(arm.buses)) if buses is None else buses)
        patches = [arm.patches_on(bus) for bus in on_buses]
        devices = [self._device(p, od) for p, od in enumerate(ods)]
        self.hosts = [
            PatchHost(devices[mine], partial(self._newest, k), boot_s[mine].tolist(), scan_ns=scan_ns)
            for k, mine in enumerate(patches)
        ]
        """By bus."""
        self._tactels = [slice(arm.patch_start[mine.start], arm.patch_start[mine.stop]) for mine in patches]
        self._sampled: Ints32 | None = None
        self._counts: list[Ints32] = []
        """Of each bus."""
        self._healthy = np.ones(arm.n_tactels, np.bool_)
        self.n_buses = len(self.hosts)
        self.devices = [device for host in self.hosts for device in host.devices]
        for device in self.devices:
            if has(device.layout.od, GUARD_PERIOD_US):
                device.set(*index_of(device.layout.od, GUARD_PERIOD_US), scan_ns // 1000)
        self.cores: list[Core] = [
            self._with_effects(host, bus) for host, bus in zip(self.hosts, on_buses, strict=True)
        ]
        """The same with effects on their traffic."""
        self._has_sample = [True] * len(self.hosts)
        self._period_ns = round(1e9 / arm.bus.rate_hz)
        self.on_sample: Callable[[int, float], None] | None = None
        """Called with bus time (ns) and scene time (s) when a sample is taken."""

    def cob_ids_on(self, bus: int) -> CobIds:
        """Identifiers that any device on a bus listens to."""
        return self.hosts[bus].cob_ids

    def scene_time(self, t_ns: int) -> float:
        """Return the scene time at a bus time (s): that of the latest SYNC up to then."""
        index = bisect_right(self._times, t_ns)
        return self._scene_s(self.n_samples - len(self._times) + index - 1)

    def _scene_s(self, sample: int) -> float:
        return max(0, sample) / self.scene.arm.bus.rate_hz % self._repeat_s

    def step(self, now_ns: int, frames: Frames = ()) -> Step:
        """Take the frames received up to ``now_ns``, do what is due, and say when to call again."""
        for frame in frames:
            if frame.can_id == SYNC_ID and not frame.flags:
                self._sync(frame.bus, now_ns)
        if len(self.cores) == 1:
            return self.cores[0].step(now_ns, frames)
        out: list[Frame] = []
        events: list[Event] = []
        wake_ns = NEVER
        for k, core in enumerate(self.cores):
            step = core.step(now_ns, [frame for frame in frames if frame.bus == k])
            out += [on_bus(k, frame) for frame in step.frames]
            events += [replace(event, bus=k) for event in step.events]
            wake_ns = min(wake_ns, step.wake_ns)
        return Step(out, events, wake_ns)

    def _device(self, p: int, od: ObjectDictionary) -> Device:
        """Return patch p."""
        node_id, ppm = int(self.scene.arm.node_id[p]), float(self.sampler.clock_ppm[p])
        if not ppm:
            return Device(od, node_id, storage={})
        device = DriftingDevice(od, node_id, storage={})
        device.ppm = ppm
        return device

    def _with_effects(self, host: PatchHost, bus: int) -> Core:
        """Return the patches of a bus with the effects on their traffic, if there are any."""
        scene = self.scene
        part = scene.arm.part(bus)
        effects = [
            effect.bind(part, stream(scene.seed, effect.name, bus))
            for effect in scene.effects
            if effect.stage is Stage.FRAMES
        ]
        if not effects:
            return host
        return SpoiltTraffic(host, effects, lambda: self._scene_s(self.n_samples - 1))

    def _sync(self, k: int, now_ns: int) -> None:
        """Take a sample for the SYNC of bus k, unless another bus had the SYNC of this cycle before."""
        if self._has_sample[k] or now_ns - self._times[-1] > self._period_ns // 2:
            self._times.append(now_ns)
            self.n_samples += 1
            t_s = self._scene_s(self.n_samples - 1)
            if self.on_sample is not None:
                self.on_sample(now_ns, t_s)
            self._has_sample = [False] * len(self.hosts)
            self.sampler.sample(t_s)
            self._sampled_ns = now_ns
        self._has_sample[k] = True

    def _newest(self, k: int, now_ns: int) -> Sample:
        """Return what the patches of bus k read: between SYNCs, too, where they run freely or guard."""
        if self._times and self.hosts[k].is_scanning and now_ns > self._times[-1]:
            since_s = min(1e-9 * (now_ns - self._times[-1]), 1e-9 * self._period_ns)
            self.sampler.sample((self._scene_s(self.n_samples - 1) + since_s) % self._repeat_s)
            self._sampled_ns = now_ns
        if self._sampled is not self.sampler.counts:
            self._sampled = self.sampler.counts
            self._counts = [self._sampled[tactels] for tactels in self._tactels]
        t_ns = self._sampled_ns if self._times else now_ns
        n = len(self.hosts[k].devices)
        return Sample(self._counts[k], np.full(n, t_ns), self._healthy[self._tactels[k]])
