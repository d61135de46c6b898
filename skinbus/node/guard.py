"""The guard of a patch: it compares its readings with its limits as they are sampled, and says so at once.

It is armed while it is OPERATIONAL, has limits, every tactel that it guards is healthy, and its newest sample
was compared and is not old. A trip is the global fail-safe command before all else, an EMCY with who and
where, and the state. It stays until it is acknowledged; then samples begin to count anew.
"""

from __future__ import annotations

import struct

import numpy as np

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.node.context import Context, Part
from skinbus.node.dictionary import SdoAbort
from skinbus.node.layout import key_of
from skinbus.node.tpdo import TpdoService
from skinbus.objects.cia import READINGS, AbortCode, EmcyCode, NmtState
from skinbus.objects.guard import GFC_ID, MAX_SAMPLES, NO_LIMIT, GuardLimits, GuardState
from skinbus.objects.profile import (
    ACKNOWLEDGE,
    GUARD_LIMITS,
    GUARD_PERIOD_US,
    GUARD_STATE,
    GUARD_TRIPPED_BY,
    HEALTHY_TACTELS,
    has,
    index_of,
)

MAX_AGE_PERIODS = 3
"""Of sampling: a sample older than that is old; one that is late or lost does not stop a robot."""

OBJECTS = (GUARD_STATE, GUARD_TRIPPED_BY, GUARD_PERIOD_US, GUARD_LIMITS, HEALTHY_TACTELS)

TRIP = struct.Struct("<Bi")
"""Data of the EMCY: number of the tactel and its reading, or 0 and the sum."""


class GuardService(Part):
    """Does nothing, and is never armed, in a device that has no such objects or no limits."""

    def __init__(self, context: Context, tpdos: TpdoService) -> None:
        super().__init__(context)
        self.is_active = False
        """Whether samples are compared now."""
        self._tpdos = tpdos
        self._limits: GuardLimits | None = None
        self._guarded = 0
        self._said = self._state, self._tripped_by = GuardState(0), 0
        self._age_ns: int | None = None
        """Of a sample that is not yet looked at."""
        self._sampled_ns = -NEVER
        self._is_new = False
        self._beyond = 0
        """Bit k: whether sample k before the newest was beyond a limit."""
        od, layout = self.dictionary.layout.od, self.dictionary.layout
        readings = next((index for index in READINGS if index in layout.indices), 0)
        self._places: list[tuple[int, int]] = []
        self._is_there = readings > 0 and all(has(od, name) for name in OBJECTS)
        if not self._is_there:
            return
        self._places = [index_of(od, name) for name in (GUARD_STATE, GUARD_TRIPPED_BY)]
        self._period = index_of(od, GUARD_PERIOD_US)
        self._health = index_of(od, HEALTHY_TACTELS)
        self._entry = layout.entries[key_of(*index_of(od, GUARD_LIMITS))]
        self._readings = self.values.view(readings, 1, len(layout.subs(readings)))
        self.dictionary.rules[self._entry.index] = lambda sub, data: self._check(data)
        self.dictionary.watchers[self._entry.index] = lambda sub: self._take_over()
        self.dictionary.writers[self._places[0][0]] = lambda sub, data: self._acknowledge(data)

    def reset(self) -> None:
        """Forget limits and trips: whoever wrote the limits must see that it is another start."""
        if self._is_there:
            self.values.store(self._entry, None)
            self._limits, self._state, self._tripped_by = None, GuardState(0), 0
            self.tick()

    def enter(self) -> None:
        """Be armed by no sample from before this NMT state, and say so: a reset does not go unnoticed."""
        self._sampled_ns = -NEVER
        self.tick()
        self._request()

    def sampled(self, age_ns: int) -> None:
        """Have the readings in the image, which are so old, compared with the next step if they are new."""
        self._age_ns = age_ns
        self.wake_ns = 0

    def tick(self) -> None:
        """Follow the NMT state, compare a new sample, and say what has changed."""
        now_ns, limits = self.context.now_ns, self._limits
        if self._age_ns is not None:
            sampled_ns, self._age_ns = now_ns - self._age_ns, None
            self._is_new |= sampled_ns != self._sampled_ns
            self._sampled_ns = sampled_ns
        self.is_active = limits is not None and self.context.state is NmtState.OPERATIONAL
        self.wake_ns, is_armed = NEVER, False
        if limits is not None and self.is_active:
            until_ns = self._sampled_ns + MAX_AGE_PERIODS * 1000 * self.values.number(*self._period)
            is_armed = now_ns <= until_ns and not self._guarded & ~self.values.number(*self._health)
            if is_armed:
                self.wake_ns = until_ns + 1
                if self._is_new:
                    self._compare(limits)
        if not is_armed:
            self._beyond = 0
        self._is_new = False
        self._say(is_armed=is_armed)

    def _compare(self, limits: GuardLimits) -> None:
        over = self._readings > limits.limits
        total = int(limits.weights @ np.maximum(self._readings - limits.rest, 0))
        tactel = int(over.argmax()) + 1 if over.any() else 0
        is_beyond = tactel > 0 or total > limits.sum_limit
        self._beyond = (self._beyond << 1 | is_beyond) & (1 << MAX_SAMPLES) - 1
        n_beyond = (self._beyond & (1 << limits.m) - 1).bit_count()
        if is_beyond and n_beyond >= limits.n and GuardState.TRIPPED not in self._state:
            self._state, self._tripped_by = GuardState.TRIPPED, tactel
            self.context.out.insert(0, Frame(GFC_ID, b"", self.context.now_ns))
            value = int(self._readings[tactel - 1]) if tactel else total
            self.emcy.raise_error(EmcyCode.GUARD_TRIPPED, data=TRIP.pack(tactel, value))
            self.emcy.tick()

    def _say(self, *, is_armed: bool) -> None:
        """Show the state, and send what maps it if it is another one."""
        state = self._state | GuardState.ARMED if is_armed else self._state
        if (state, self._tripped_by) == self._said:
            return
        self._said = state, self._tripped_by
        for place, value in zip(self._places, self._said, strict=True):
            self.values.put(*place, value)
        self._request()

    def _request(self) -> None:
        for pdo in self._tpdos.pdos.values():
            if any((entry.index, entry.sub) in self._places for entry in pdo.map.entries):
                self._tpdos.request(pdo.number)

    def _check(self, data: bytes) -> None:
        try:
            self._decode(data)
        except ValueError as error:
            raise SdoAbort(AbortCode.VALUE_INVALID) from error

    def _decode(self, data: bytes) -> GuardLimits | None:
        return GuardLimits.decode(data, len(self._readings)) if data else None

    def _take_over(self) -> None:
        """Compare with new limits from now on: first the newest sample, in place of the old comparison."""
        limits = self._limits = self._decode(self.values.load(self._entry) or b"")
        guarded = () if limits is None else (limits.weights > 0) | (limits.limits < NO_LIMIT)
        self._guarded = sum(1 << k for k, is_guarded in enumerate(guarded) if is_guarded)
        self._beyond >>= 1
        self._is_new = True
        self.tick()

    def _acknowledge(self, data: bytes) -> None:
        if int.from_bytes(data, "little") != ACKNOWLEDGE:
            raise SdoAbort(AbortCode.VALUE_INVALID)
        if GuardState.TRIPPED in self._state:
            self._state, self._tripped_by, self._beyond = GuardState(0), 0, 0
            self.emcy.clear_error(EmcyCode.GUARD_TRIPPED)
            self.tick()
