"""Pressures to contacts: the stages of a cycle in their order, and the door that checks what comes in."""

from __future__ import annotations

import operator
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from numba.core import event

from skinbus.estimate.cluster import cluster_patch
from skinbus.estimate.contacts import LEVELS, Contacts
from skinbus.estimate.kernel import kernel, number, part
from skinbus.estimate.layout import Bools, Floats, Layout, compile_layout
from skinbus.estimate.merge import EVIDENCE, merge_clusters, write_contacts
from skinbus.estimate.refine import refine_contacts
from skinbus.estimate.select import select_contacts
from skinbus.estimate.workspace import NO_VALUE, SATURATED, VALUE, Work, make_workspace
from skinbus.model import Arm

NO_LIMIT = 2**62
FAINT = 3.0
"""Standard deviations of a reading: where contacts are fitted, several tactels that feel little make one."""
FAINT_EVIDENCE = 18.0
"""Sum of (p/sigma)^2 from which a fit is tried: two tactels that just feel something."""


class Estimator:
    """Turns the pressures of one cycle into contacts on the surface of an arm.

    ``level``       "kmeans"
    ``start``       "maxima" (deterministic) or "random" (the paper's)
    ``k``           contacts of a touched patch, if they are known; None chooses
    ``seed``        of the random starts
    ``on_compile``  called once if the kernels have to be compiled first, which takes a while

    Everything is compiled and allocated when the constructor returns; ``compiled`` says whether the
    kernels had to be compiled or were found in numba's cache.
    """

    def __init__(
        self,
        arm: Arm,
        level: str = "kmeans",
        *,
        start: str = "maxima",
        k: int | None = None,
        seed: int = 0,
        on_compile: Callable[[], None] | None = None,
    ) -> None:
        if level not in LEVELS:
            raise ValueError(f"level must be one of {', '.join(LEVELS)}; got {level!r}")
        if start not in ("maxima", "random"):
            raise ValueError(f"start must be 'maxima' or 'random', got {start!r}")
        if k is not None and k < 1:
            raise ValueError(f"k must be at least 1, got {k}")
        self.arm = arm
        self.level = level
        self._rank = LEVELS.index(level)
        with _CompileWatch(on_compile) as watch:
            self._layout = compile_layout(arm)
            self._work = make_workspace(self._layout)
            self._k = 0 if k is None else k
            self._random = start == "random"
            self._valid = np.ones(arm.n_tactels, np.bool_)
            self._run(np.zeros(arm.n_tactels), self._valid)
        self.compiled = watch.compiled
        self._work.random[0] = 1 + seed % 2147483646  # the generator's states are 1 ... 2^31 - 2

    def update(self, pressures: npt.ArrayLike, t_ns: int, valid: npt.ArrayLike | None = None) -> Contacts:
        """Return the contacts of one cycle.

        pressures: (n_tactels,) Pa, calibrated. NaN and infinity say nothing; full scale says "at least".
        t_ns:      time of the cycle.
        valid:     (n_patches,) or (n_tactels,), False where a reading is missing; None for all there.

        Raises:
            TypeError: ``t_ns`` is no integer.
            ValueError: an array has the wrong shape.
        """
        t_ns = operator.index(t_ns)  # a time of another kind would come to light far from here, on the bus
        pressures = np.ascontiguousarray(pressures, np.float64)
        if pressures.shape != (self.arm.n_tactels,):
            raise ValueError(f"pressures must have shape ({self.arm.n_tactels},), got {pressures.shape}")
        self._run(pressures, self._valid if valid is None else self._spread_valid(valid))
        return Contacts.from_workspace(self._work, t_ns)

    def _run(self, pressures: Floats, valid: Bools) -> None:
        lay, work = self._layout, self._work
        work.work[:] = 0, NO_LIMIT
        find_clusters(lay, work, pressures, valid, self._k, self._random, self._rank > 0)
        if self._rank > 0:
            refine_contacts(lay, work)
        if self._rank > 1:
            select_contacts(lay, work)

    def _spread_valid(self, valid: npt.ArrayLike) -> Bools:
        flags = np.ascontiguousarray(valid, np.bool_)
        if flags.shape == (self.arm.n_tactels,):
            return flags
        if flags.shape == (self.arm.n_patches,):
            return np.take(flags, self.arm.tactel_patch)
        n, m = self.arm.n_patches, self.arm.n_tactels
        raise ValueError(f"valid must have shape ({n},) or ({m},), got {flags.shape}")


@kernel
def find_clusters(
    lay: Layout, w: Work, pressures: Floats, valid: Bools, k_wanted: int, random: bool, faint: bool
) -> None:
    """Take the pressures of a cycle and write the contacts of level ``kmeans``."""
    take_pressures(lay, w, pressures, valid, faint)
    n_clusters = number(0)
    for patch in range(len(lay.patch_link)):
        if w.touched[patch]:
            n_clusters += cluster_patch(lay, w, patch, n_clusters, k_wanted, random)
    merge_clusters(lay, w, n_clusters)
    write_contacts(lay, w, n_clusters, FAINT_EVIDENCE if faint else EVIDENCE)


@part
def take_pressures(lay: Layout, w: Work, pressures: Floats, valid: Bools, faint: bool) -> None:
    """Copy the pressures, made finite and within full scale; note what each tactel knows.

    ``faint`` also takes tactels below the threshold as touched: what they make must prove itself later.
    """
    p_out, state, active, label = w.p, w.state, w.active, w.label
    healthy, limits, threshold, start = lay.healthy, lay.limit, lay.threshold, lay.patch_start
    sigma = lay.sigma
    for patch in range(len(start) - 1):
        touched = False
        for i in range(start[patch], start[patch + 1]):
            p, limit = pressures[i], limits[i]
            label[i] = -1
            active[i] = False
            if not (valid[i] and healthy[i] and np.isfinite(p)):
                p_out[i] = 0.0
                state[i] = NO_VALUE
                continue
            state[i] = SATURATED if p >= limit else VALUE
            p_out[i] = min(max(p, -limit), limit)
            least = min(threshold[i], FAINT * sigma[i]) if faint else threshold[i]
            if p >= least and p > 0.0:
                active[i] = True
                touched = True
        w.touched[patch] = touched


class _CompileWatch(event.Listener):
    """Notices while it is open that numba compiles instead of loading from its cache."""

    def __init__(self, on_compile: Callable[[], None] | None) -> None:
        self._tell = on_compile
        self.compiled = False

    def on_start(self, event: object) -> None:
        if not self.compiled:
            self.compiled = True
            if self._tell is not None:
                self._tell()

    def on_end(self, event: object) -> None:
        pass

    def __enter__(self) -> _CompileWatch:
        event.register("numba:compile", self)  # type: ignore[no-untyped-call]
        return self

    def __exit__(self, *exc: object) -> None:
        event.unregister("numba:compile", self)  # type: ignore[no-untyped-call]
