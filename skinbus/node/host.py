"""The patches of one bus: CANopen devices behind one core that send the newest readings of a source.

A source is a scene, a sensor, or a skin that is not CANopen. Frames reach only the devices that listen to
them, and a device is woken only when it asked for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from heapq import heappop, heappush
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from skinbus.arrays import Bools, Ints, Ints32
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event
from skinbus.can.frame import REMOTE_ID, RTR, CobIds, Frame, Frames
from skinbus.node.device import Device
from skinbus.objects.cia import READINGS, SOURCE_STOPPED, SYNC_ID, TACTELS_FAILED, EmcyCode, NmtState
from skinbus.objects.guard import GFC_ID
from skinbus.objects.profile import AGE_STEP_NS, HEALTHY_TACTELS, SAMPLE_AGE, has, index_of


class Sample(NamedTuple):
    """What all patches of a host read, one after the other in the order of its devices."""

    counts: Ints32
    """(n_tactels,) left-adjusted."""
    t_ns: Ints
    """(n_patches,) when each was sampled."""
    healthy: Bools
    """(n_tactels,) False where the count means nothing; a patch without any has stopped."""


SCAN_NS = 1_000_000
"""From one look at the readings of patches that run freely or guard to the next, where none is given."""

START_NS = 500_000_000
"""For so long patches are not there until all tactels have readings: one that has none yet has not failed."""

Source = Callable[[int], Sample]
"""Return the newest sample at a time (ns), without waiting; it is asked at each SYNC.

For patches that run freely, and for those that guard, it is asked between SYNCs, too.
Counts that change come as a new array: one that was returned before is not looked at again.
"""


class PatchHost(Core):
    """A core, made of cores: the patches on one bus.

    Args:
        devices: one for each patch; their readings are 0x6401 or 0x6400.
        source: what they read.
        boot_s: (n_patches,) time from power-on to the first sign of life, s; none if not given.
        scan_ns: from one look at the source between SYNCs to the next.
    """

    cob_ids: CobIds = frozenset({SYNC_ID})
    """Identifiers that any device listens to, and SYNC: it asks the source even when none does."""

    def __init__(
        self,
        devices: Sequence[Device],
        source: Source,
        boot_s: Sequence[float] = (),
        *,
        scan_ns: int = SCAN_NS,
    ) -> None:
        self.devices = devices
        self._step_ns = scan_ns
        self._source = source
        self._shows = [
            device.image_view(index, 1, len(device.layout.subs(index)))
            for device in devices
            for index in READINGS
            if index in device.layout.indices
        ]
        """Where the TPDOs of each patch find its readings."""
        self._sizes = np.array([len(view) for view in self._shows])
        self._ends = np.cumsum(self._sizes)
        ends = [0, *self._ends.tolist()]
        self._tactels = [slice(*pair) for pair in pairwise(ends)]
        self._shown: Sample | None = None
        self._healthy = np.ones(ends[-1], np.bool_)
        self._counts = np.concatenate(self._shows).astype(np.int32)
        self._lowest = np.concatenate([np.full(len(v), np.iinfo(v.dtype).min) for v in self._shows])
        self._ages = {
            i: device.view_of(SAMPLE_AGE, 1)
            for i, device in enumerate(devices)
            if has(device.layout.od, SAMPLE_AGE)
        }
        """Where the TPDOs of each patch find the age of its sample."""
        self._since_ns = self._age = np.zeros(len(devices), np.int64)
        self._cleared = [0] * len(devices)
        """Bits of "Healthy tactels" that were set and are not now."""
        for i, device in enumerate(devices):
            device.on_nmt = partial(self._report, i)
        self._boot_s = boot_s or [0.0] * len(devices)
        self._wake_ns = [NEVER] * len(devices)
        self._wakes: list[tuple[int, int]] = []
        self._listeners: dict[int, list[int]] = {}
        self._heard: list[CobIds] = [frozenset()] * len(devices)
        self._scanned: set[int] = set()
        """Devices that run freely or guard."""
        self._scan_ns = NEVER
        self.is_on = False
        """Whether the patches have power."""
        self._begun_ns = NEVER
        self.deaf: CobIds = frozenset()
        """Node-IDs of those that receive nothing now: their plug is pulled."""

    @property
    def is_scanning(self) -> bool:
        """Whether the source is looked at between SYNCs, too: any device runs freely or guards."""
        return bool(self._scanned)

    def step(self, now_ns: int, frames: Frames = ()) -> Step:
        """Take the frames received up to ``now_ns``, do what is due, and say when to call again."""
        out: list[Frame] = []
        events: list[Event] = []
        if not self.is_on:
            self._begun_ns = min(self._begun_ns, now_ns)
            if now_ns < self._begun_ns + START_NS and not self._source(now_ns).healthy.all():
                return Step((), (), now_ns + SCAN_NS)
            self.is_on = True
            for i, boot_s in enumerate(self._boot_s):
                self.wake(i, now_ns + round(1e9 * boot_s))
            self._show(now_ns)
        for frame in frames:
            if frame.can_id == SYNC_ID and not frame.flags:
                self._show(now_ns)
            frame_id = frame.can_id | REMOTE_ID if frame.flags == RTR else frame.can_id
            for i in self._listeners.get(frame_id, ()):
                if self.devices[i].node_id not in self.deaf:
                    self._step(i, now_ns, (frame,), out, events)
        if now_ns >= self._scan_ns:
            self._scan(now_ns, out, events)
        while self._wakes and self._wakes[0][0] <= now_ns:
            wake_ns, i = heappop(self._wakes)
            if self._wake_ns[i] == wake_ns:
                self._wake_ns[i] = NEVER
                self._step(i, now_ns, (), out, events)
        if self._scanned:  # equal frames of many patches are one on a wire
            stops = [frame for frame in out if frame.can_id == GFC_ID]
            out = stops[:1] + [frame for frame in out if frame.can_id != GFC_ID]
        return Step(out, events, self.wake_ns)

    @property
    def wake_ns(self) -> int:
        """When a device is to be stepped next, ns."""
        return min(self._scan_ns, self._wakes[0][0] if self._wakes else NEVER)

    def not_sent(self, now_ns: int, frames: Frames) -> None:
        """Have the EMCY messages among these frames sent again."""
        for i, device in enumerate(self.devices):
            device.not_sent(now_ns, frames)
            self.wake(i, now_ns)

    def wake(self, i: int, wake_ns: int) -> None:
        """Have device i stepped at a time, and not before unless it receives something."""
        if wake_ns != self._wake_ns[i]:
            self._wake_ns[i] = wake_ns
            if wake_ns < NEVER:
                heappush(self._wakes, (wake_ns, i))

    def _scan(self, now_ns: int, out: list[Frame], events: list[Event]) -> None:
        """Step the devices that run freely or guard and have something new."""
        self._scan_ns = now_ns + self._step_ns
        changed = self._show(now_ns)
        for i in sorted(self._scanned):
            if self.devices[i].guards:
                self.devices[i].sampled(int(self._since_ns[i]))
            elif i not in changed:
                continue
            self._step(i, now_ns, (), out, events)

    def _show(self, now_ns: int) -> list[int]:
        """Put the newest readings where the TPDOs find them; return which devices have others than before."""
        shown, sample = self._shown, self._source(now_ns)
        self._shown = sample
        self._since_ns = now_ns - sample.t_ns
        self._age = np.minimum(np.maximum(self._since_ns // AGE_STEP_NS, 0), 0xFFFF)
        if shown and sample.counts is shown.counts and sample.healthy is shown.healthy:
            return []
        if not shown or sample.healthy is not shown.healthy:
            self._judge(now_ns, sample.healthy)
        counts = sample.counts
        if not self._healthy.all():
            counts = np.where(self._healthy, counts, self._lowest)
        changed = np.flatnonzero(
            np.logical_or.reduceat(counts != self._counts, self._ends - self._sizes)
        ).tolist()
        for i in changed:
            self._shows[i][:] = counts[self._tactels[i]]
        self._counts = counts
        return changed

    def _judge(self, now_ns: int, healthy: Bools) -> None:
        """Report the patches of which tactels are no longer healthy, or are again."""
        (changed,) = np.nonzero(healthy != self._healthy)
        self._healthy = healthy
        for i in np.unique(np.searchsorted(self._ends, changed, "right")).tolist():
            self._report(i)
            self.wake(i, now_ns)

    def _report(self, i: int, state: NmtState = NmtState.PRE_OPERATIONAL) -> None:
        """Have device i say which of its tactels are healthy; after a reset it has forgotten."""
        if state is not NmtState.PRE_OPERATIONAL:
            return
        device, own = self.devices[i], self._healthy[self._tactels[i]]
        is_stopped = not own.any()
        device.stop_readings(is_stopped)
        for fault, is_there in (
            (SOURCE_STOPPED, is_stopped),
            (TACTELS_FAILED, not (is_stopped or own.all())),
        ):
            (device.emcy if is_there else device.emcy_clear)(EmcyCode.HARDWARE, fault)
        if has(od := device.layout.od, HEALTHY_TACTELS):
            place = index_of(od, HEALTHY_TACTELS)
            others = device.get(*place) | self._cleared[i]
            bits = int.from_bytes(np.packbits(own, bitorder="little").tobytes(), "little")
            self._cleared[i] = others & ~bits
            device.set(*place, others & bits)

    def _step(self, i: int, now_ns: int, frames: Frames, out: list[Frame], events: list[Event]) -> None:
        device = self.devices[i]
        if i in self._ages:
            self._ages[i][0] = self._age[i]
        step = device.step(now_ns, frames)
        out += step.frames
        events += step.events
        self.wake(i, step.wake_ns)
        if (device.runs_freely or device.guards) != (i in self._scanned):
            self._scanned ^= {i}
            self._scan_ns = min(self._scan_ns, now_ns + self._step_ns) if self._scanned else NEVER
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
        self.cob_ids = frozenset(listeners) | {SYNC_ID}
