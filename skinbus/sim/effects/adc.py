"""ADC: a converter of fewer bits than the object, over a range of its own; left-adjusted as in CiA 401."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.jit import kernel
from skinbus.model import Arm
from skinbus.sim.effect import CountStep, Effect, Floats, Ints, Stage, parameter


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
        fulls = [
            t.full_counts
            if self.range_kpa is None
            else max(1, min(t.full_counts, round(1e3 * self.range_kpa / t.step)))
            for t in transducers
        ]
        # the converter's values spread over its range: 2^(bits - 1) of each sign
        spans = [full + (full == t.full_counts) for full, t in zip(fulls, transducers, strict=True)]
        widths = [max(1.0, span / (1 << (self.bits - 1))) for span in spans]
        width_of = np.repeat(np.array(widths), counts)
        top_of = np.repeat(np.array(fulls, np.int32), counts)

        def step(counts: Ints, t_s: float) -> None:
            _convert(counts, width_of, top_of)

        return step


@kernel
def _convert(counts: Ints, width_of: Floats, top_of: Ints) -> None:
    for i in range(len(counts)):
        width, top = width_of[i], top_of[i]
        n = np.floor(min(max(counts[i], -top - 1), top) / width + 0.5)
        while n * width > top:
            n -= 1.0
        counts[i] = np.int32(np.rint(n * width))
