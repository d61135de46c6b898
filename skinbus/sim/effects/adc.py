"""ADC: a converter of fewer bits than the object, over a range of its own; left-adjusted as in CiA 401."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import CountStep, Effect, Ints, Stage, parameter, settings


@settings
class Adc(Effect):
    """Quantises to ``bits``, sign included, and clips to the range."""

    stage = Stage.COUNTS
    # the converters inside common microcontrollers have 12 bits
    bits: int = parameter(
        12, "", "bits of the converter, sign included; 16 is as fine as the object", ge=2, le=16
    )
    range_kpa: float | None = parameter(
        None, "kPa", "largest pressure; the boards' full scale if not given", gt=0
    )

    def bind(self, arm: Arm, rng: np.random.Generator) -> CountStep:
        """Return ``step(counts, t_s) -> counts``."""
        transducers = [placed.patch.transducer for placed in arm.patches]
        full = np.array([t.full_counts for t in transducers], np.float64)
        top = full.copy()
        if self.range_kpa is not None:
            step_pa = np.array([t.step for t in transducers])
            top = np.clip(np.round(1e3 * self.range_kpa / step_pa), 1.0, full)
        # the converter's values spread over its range: 2^(bits - 1) of each sign
        width = np.maximum(1.0, (top + (top == full)) / (1 << (self.bits - 1)))
        width, top = (np.repeat(column, np.diff(arm.patch_start)) for column in (width, top))

        def step(counts: Ints, t_s: float) -> Any:
            n = np.floor(np.clip(counts, -top - 1.0, top) / width + 0.5)
            n -= n * width > top
            return np.rint(n * width).astype(np.int32)

        return step
