"""ADC: a converter of fewer bits than the object, over a range of its own; left-adjusted as CiA 401 wants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numba import njit

from skinbus.model import Arm
from skinbus.sim.effect import CountStep, Effect, Ints, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Adc(Effect):
    """Quantises to ``bits``, sign included, and clips to the range."""

    name = "adc"
    stage = Stage.COUNTS
    # the converters inside common microcontrollers have 12 bits
    bits: Annotated[
        int, parameter("", "bits of the converter, sign included; 16 is as fine as the object", ge=2, le=16)
    ] = 12
    range_kpa: Annotated[
        float | None, parameter("kPa", "largest pressure; the boards' full scale if not given", gt=0)
    ] = None

    def bind(self, arm: Arm, rng: np.random.Generator) -> CountStep:
        """Return ``step(counts, t_s)``."""
        counts = np.diff(arm.patch_start)
        transducers = [placed.patch.transducer for placed in arm.patches]
        # one step of the converter in counts of the object; an 8-bit object is never finer than itself
        steps = [1 << max(0, transducer.bits - self.bits) for transducer in transducers]
        tops = [
            t.full_counts
            if self.range_kpa is None
            else min(t.full_counts, round(1e3 * self.range_kpa / t.step))
            for t in transducers
        ]
        step_of = np.repeat(np.array(steps, np.int32), counts)
        top_of = np.repeat(np.array(tops, np.int32), counts)

        def step(counts: Ints, t_s: float) -> None:
            _convert(counts, step_of, top_of)

        return step


@njit(cache=True, nogil=True)
def _convert(counts: Ints, step_of: Ints, top_of: Ints) -> None:
    for i in range(len(counts)):
        width, top = step_of[i], top_of[i]
        c = min(max(counts[i], -top - 1), top)
        # the nearest step that is inside the range
        c = (c + width // 2) // width * width
        if c > top:
            c -= width
        counts[i] = c
