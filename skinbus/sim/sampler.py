"""From scene time to counts: the layer, then the steps of the effects that a scene names, in physical order.

A sampler holds the state of one run. Where nothing presses and no effect is bound, a sample does no work at
all; the layer is computed only for tactels within reach of a touch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.jit import kernel
from skinbus.model.mesh_surface import mesh_links
from skinbus.sim.effect import CountStep, PressureStep, Stage, stream
from skinbus.sim.layer import Geometry
from skinbus.sim.on_meshes import OnMeshes
from skinbus.sim.scene import Scene

Floats = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int32]


class Sampler:
    """One run of a scene up to the converter.

    counts:      (n_tactels,) int32, left-adjusted; the last sample
    pressures:   (n_tactels,) Pa, what the layer brought to the tactels
    clock_ppm:   (n_patches,) by how much each board's clock is fast
    """

    def __init__(self, scene: Scene) -> None:
        self._arm = arm = scene.arm
        self._effects = scene.effects
        steps: dict[Stage, list[Any]] = {stage: [] for stage in Stage}
        for effect in scene.effects:
            if effect.stage is Stage.FRAMES:
                continue  # the world binds them to its buses
            steps[effect.stage].append(effect.bind(arm, stream(scene.seed, effect.name)))
        geometry = Geometry.of(arm, discs=scene.layer.discs)
        for mount in steps[Stage.GEOMETRY]:
            mount(geometry)
        self._plan = scene.plan
        self._law = scene.layer.bind(geometry, scene.plan.indenters) if scene.touches else None
        if self._law is not None and mesh_links(link.surface for link in arm.links):
            self._law = OnMeshes(self._law, geometry)
        self._time: list[Callable[[float], float]] = steps[Stage.TIME]
        self._layer: list[PressureStep] = steps[Stage.LAYER]
        self._tactel: list[PressureStep] = steps[Stage.TACTEL]
        self._count: list[CountStep] = steps[Stage.COUNTS]
        self.clock_ppm = np.zeros(arm.n_patches)
        for clock in steps[Stage.CLOCK]:
            clock(self.clock_ppm)

        counts = np.diff(arm.patch_start)
        transducers = [placed.patch.transducer for placed in arm.patches]
        step = np.repeat([transducer.step for transducer in transducers], counts)
        self._per_pa = 1.0 / (step * arm.tactel_gain)
        self._zero = arm.tactel_offset.astype(np.float64)
        if geometry.offset is not None:
            self._zero += geometry.offset * self._per_pa
        self._top = np.repeat([transducer.top_counts for transducer in transducers], counts).astype(np.int32)
        self._width = np.repeat([float(t.converter_counts) for t in transducers], counts)
        self._touched = np.ones(arm.n_patches, np.bool_)
        self._starts = arm.patch_start
        self._changes = bool(self._layer or self._tactel or self._count)
        self._signal = np.zeros(arm.n_tactels) if self._layer or self._tactel else None
        self.pressures = np.zeros(arm.n_tactels)
        self.counts: Counts = np.zeros(arm.n_tactels, np.int32)
        self._load_kernels()

    def sample(self, t_s: float) -> bool:
        """Take a sample at a scene time into ``counts``; False when nothing can have changed."""
        really_s = t_s
        for shift in self._time:
            really_s = shift(really_s)
        pressed = self._press(really_s)
        if not (pressed or self._changes):
            return False
        signal = self.pressures
        if self._signal is not None:
            signal = self._signal
            np.copyto(signal, self.pressures)
            for step in self._layer:
                step(signal, t_s)
            for step in self._tactel:
                step(signal, t_s)
        _to_counts(signal, self._per_pa, self._zero, self._top, self._width, self.counts)
        for count in self._count:
            count(self.counts, t_s)
        return True

    def _press(self, t_s: float) -> bool:
        """Bring the layer to a time; False when it was and is at rest."""
        if self._law is None:
            before = bool(self._touched[0])  # the first sample of all
            self._touched[:] = False
            return before
        loads = self._plan.load(t_s)
        before = _forget(self._touched, self._starts, self.pressures)
        if loads.n:
            self._law.add(loads, self.pressures, self._touched)
        return before or loads.n > 0

    def _load_kernels(self) -> None:
        """Have every kernel compiled, or read from numba's cache, before the first sample is due."""
        if self._law is not None:
            loads = self._plan.load(-1.0)  # before any touch
            self._law.add(loads, self.pressures, np.zeros_like(self._touched))
        # steps that nobody keeps, on streams that nobody shares
        rng = np.random.default_rng(0)
        for effect in self._effects:
            if effect.stage in (Stage.LAYER, Stage.TACTEL):
                effect.bind(self._arm, rng)(np.zeros_like(self.pressures), 0.0)
            elif effect.stage is Stage.COUNTS:
                effect.bind(self._arm, rng)(np.zeros_like(self.counts), 0.0)
        _forget(np.zeros_like(self._touched), self._starts, self.pressures)
        _to_counts(self.pressures, self._per_pa, self._zero, self._top, self._width, self.counts)


@kernel
def _forget(touched: npt.NDArray[np.bool_], starts: Counts, pressures: Floats) -> bool:
    """Take the last sample's loads off the patches they touched; False when there were none."""
    found = False
    for p in range(len(touched)):
        if touched[p]:
            touched[p] = False
            found = True
            for i in range(starts[p], starts[p + 1]):
                pressures[i] = 0.0
    return found


@kernel
def _to_counts(
    signal: Floats, per_pa: Floats, zero: Floats, top: Counts, width: Floats, counts: Counts
) -> None:
    """Round to values of the converter, ``width`` counts apart, and clip to those it has; NaN reads as 0.

    The same law as model.Transducer.
    """
    for i in range(len(signal)):
        x = np.rint((signal[i] * per_pa[i] + zero[i]) / width[i]) * width[i]
        if x >= top[i]:
            counts[i] = top[i]
        elif x <= -top[i] - width[i]:
            counts[i] = -top[i] - np.int32(width[i])
        elif x == x:
            counts[i] = np.int32(x)
        else:
            counts[i] = 0
