"""Events of analogue inputs (CiA 401): limits and deltas that make event-driven TPDOs worth sending.

An input is in range when it has no limit selected, or is at or above its upper, or at or below its lower
limit. In range, it is worth sending when it moved by more than a selected delta since it was last sent; with
no delta selected, when it moved at all. Limits and deltas are counts of the input. 0x6423 FALSE: no events.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Ints
from skinbus.node.context import Context, Part
from skinbus.node.tpdo import Tpdo, TpdoService
from skinbus.objects.cia import (
    ANALOGUE_DELTA,
    ANALOGUE_INTERRUPT_ENABLE,
    ANALOGUE_LOWER_LIMIT,
    ANALOGUE_TRIGGER,
    ANALOGUE_UPPER_LIMIT,
    READINGS,
    NmtState,
    Trigger,
)
from skinbus.objects.pdo import readings_in

OBJECTS = (
    *(ANALOGUE_TRIGGER, ANALOGUE_INTERRUPT_ENABLE),
    *(ANALOGUE_UPPER_LIMIT, ANALOGUE_LOWER_LIMIT, ANALOGUE_DELTA),
)
_NO_LIMIT = np.int64(2**62)


class AnalogueTriggers(Part):
    """Watches the inputs that event-driven and acyclic TPDOs carry, in one vectorised comparison."""

    def __init__(self, context: Context, tpdos: TpdoService) -> None:
        super().__init__(context)
        self.layout, self.tpdos = self.dictionary.layout, tpdos
        self.active = False
        """Whether ``poll`` can find anything."""
        self.index = next((i for i in READINGS if i in self.layout.indices), 0)
        self.n = len(self.layout.subs(self.index))
        self._inputs: npt.NDArray[Any] = self.values.view(self.index, 1, self.n) if self.n else np.zeros(0)
        self._sent = np.zeros(self.n, np.int64)
        self._known = np.zeros(self.n, np.bool_)
        self._channels: dict[int, Bools] = {}
        self.dictionary.watchers |= dict.fromkeys(OBJECTS, lambda sub: self.configure())

    def enter(self, state: NmtState) -> None:
        """With OPERATIONAL everything is news again."""
        self._known[:] = False
        self.configure()

    def configure(self) -> None:
        """Take over triggers, limits and PDOs."""
        subs = {
            pdo.number: [entry.sub for entry in readings_in(pdo.map)]
            for pdo in self.tpdos.pdos.values()
            if pdo.map.valid and not pdo.cyclic
        }
        inputs = np.arange(1, self.n + 1)
        self._channels = {number: np.isin(inputs, own) for number, own in subs.items() if own}
        enabled = bool(self.values.number(ANALOGUE_INTERRUPT_ENABLE, 0))
        self.active = enabled and bool(self._channels) and self.context.state is NmtState.OPERATIONAL
        if not self.active:
            return
        select = self._column(ANALOGUE_TRIGGER)
        self._upper = np.where(select & Trigger.UPPER, self._column(ANALOGUE_UPPER_LIMIT), _NO_LIMIT)
        self._lower = np.where(select & Trigger.LOWER, self._column(ANALOGUE_LOWER_LIMIT), -_NO_LIMIT)
        self._unlimited = ((select & (Trigger.UPPER | Trigger.LOWER)) == 0) & (select != 0)
        # A band around the value sent last: leaving it is an event. No delta selected: any move leaves.
        self._band = np.where(select & Trigger.DELTA, self._column(ANALOGUE_DELTA), 0)

    def poll(self) -> None:
        """Ask for every TPDO with an input worth sending."""
        values = self._inputs.astype(np.int64)
        worth = (np.abs(values - self._sent) > self._band) | ~self._known
        worth &= self._unlimited | (values >= self._upper) | (values <= self._lower)
        if worth.any():
            for number, mask in self._channels.items():
                if (worth & mask).any():
                    self.tpdos.request(number)

    def sent(self, pdo: Tpdo) -> None:
        """Keep what a TPDO has carried."""
        mask = self._channels.get(pdo.number)
        if mask is not None:
            self._sent[mask] = self._inputs[mask]
            self._known |= mask

    def _column(self, index: int) -> Ints:
        """Values of an array object, one for each input; zero where it has none."""
        subs, own = range(1, self.n + 1), self.layout.subs(index)
        return np.array([self.values.get(index, sub) if sub in own else 0 for sub in subs], np.int64)
