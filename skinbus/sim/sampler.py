"""From scene time to counts: the layer, then the steps of the effects that a scene names, in physical order.

A sampler holds the state of one run. Where nothing presses and no effect is bound, a sample does no work at
all; the layer is computed only for touches that press.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skinbus.arrays import Floats, Ints32
from skinbus.sim.effect import Stage, stream
from skinbus.sim.layer import Geometry
from skinbus.sim.scene import Scene


class Sampler:
    """One run of a scene up to the converter.

    counts:      (n_tactels,) int32, left-adjusted; the last sample
    pressures:   (n_tactels,) Pa, what the layer brought to the tactels
    clock_ppm:   (n_patches,) by how much each board's clock is fast
    """

    def __init__(self, scene: Scene) -> None:
        arm = scene.arm
        self._steps: dict[Stage, list[Any]] = {stage: [] for stage in Stage}
        for effect in scene.effects:
            if effect.stage is not Stage.FRAMES:  # the world binds those to its buses
                self._steps[effect.stage].append(effect.bind(arm, stream(scene.seed, effect.name)))
        geometry = Geometry.of(arm, discs=scene.layer.discs)
        for mount in self._steps[Stage.GEOMETRY]:
            mount(geometry)
        self._plan = scene.plan
        self._law = scene.layer.bind(geometry, scene.plan.indenters) if scene.touches else None
        self.clock_ppm = np.zeros(arm.n_patches)
        for clock in self._steps[Stage.CLOCK]:
            self.clock_ppm = clock(self.clock_ppm)
        transducers = [placed.patch.transducer for placed in arm.patches]
        columns = np.array([(t.step, t.top_counts, t.converter_counts) for t in transducers], np.float64)
        step, self._top, self._width = columns[arm.tactel_patch].T
        self._per_pa = 1.0 / (step * arm.tactel_gain)
        self._zero = arm.tactel_offset.astype(np.float64)
        if geometry.offset is not None:
            self._zero += geometry.offset * self._per_pa
        self._is_at_rest = False
        self._changes = any(self._steps[stage] for stage in (Stage.LAYER, Stage.TACTEL, Stage.COUNTS))
        self.pressures = np.zeros(arm.n_tactels)
        self.counts: Ints32 = np.zeros(arm.n_tactels, np.int32)

    def sample(self, t_s: float) -> None:
        """Take a sample at a scene time into ``counts``, if anything can have changed."""
        really_s = t_s
        for shift in self._steps[Stage.TIME]:
            really_s = shift(really_s)
        pressed = self._press(really_s)
        if not (pressed or self._changes):
            return
        signal = self.pressures
        for step in (*self._steps[Stage.LAYER], *self._steps[Stage.TACTEL]):
            signal = step(signal, t_s)
        self.counts = self._converted(signal)
        for step in self._steps[Stage.COUNTS]:
            self.counts = step(self.counts, t_s)

    def _press(self, t_s: float) -> bool:
        """Bring the layer to a time; False when it was and is at rest."""
        was_at_rest, self._is_at_rest = self._is_at_rest, True
        if self._law is not None:
            loads = self._plan.load(t_s)
            self._is_at_rest = loads.n == 0
            if not (self._is_at_rest and was_at_rest):
                self.pressures[:] = 0.0
                self._law.add(loads, self.pressures)
        return not (self._is_at_rest and was_at_rest)

    def _converted(self, signal: Floats) -> Any:
        """Return values of the converter, ``width`` counts apart and of those it has; NaN reads as 0.

        The same law as model.Transducer.
        """
        counts = np.rint((signal * self._per_pa + self._zero) / self._width) * self._width
        return np.nan_to_num(np.clip(counts, -self._top - self._width, self._top)).astype(np.int32)
