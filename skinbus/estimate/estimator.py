"""Pressures to contacts: the stages of a cycle in their order, and the door that checks what comes in."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats
from skinbus.estimate.baseline import Baseline
from skinbus.estimate.budget import MONOTONIC, Clock, begin, set_budget
from skinbus.estimate.contacts import DEFAULT_LEVEL, LEVELS, Contacts
from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.kernels.board_offset import subtract_offsets
from skinbus.estimate.kernels.layout import Layout, compile_layout, length_unit
from skinbus.estimate.kernels.workspace import (
    FREE,
    HELD,
    NO_VALUE,
    PATCH_CLUSTERS,
    RANDOM,
    RANK,
    SATURATED,
    VALUE,
    K,
    Search,
    Work,
    make_search,
    make_workspace,
)
from skinbus.estimate.levels.kmeans import cluster_patch
from skinbus.estimate.levels.merge import merge_clusters, write_contacts
from skinbus.estimate.search.groups import search_contacts
from skinbus.jit import inner_kernel, kernel, runtime_int
from skinbus.model import Arm
from skinbus.model.validation import check_arm, check_integer, check_time


class Estimator:
    """Turns the pressures of one cycle into contacts on the surface of an arm.

    ``level``        "kmeans", "fit" or "full"
    ``budget_us``    time for one cycle, us; None is all the time it takes
    ``budget_work``  work for one cycle, pressures evaluated by fits: the same bits on every machine; never
                     more than ``budget.most_work``
    ``clock``        what ``budget_us`` is measured by; the machine's monotonic clock unless given
    ``start``        "maxima" (deterministic) or "random" (the paper's)
    ``k``            contacts of a touched patch, if they are known; None chooses
    ``seed``         of the random starts

    Everything is compiled and allocated when the constructor returns.

    A cycle always reads all pressures and clusters every touched patch: no touch is lost to a budget. After
    that the budget is looked at before every iteration of a fit. When it is used up, groups of contacts that
    were not fitted keep the answer of the cheaper level, and all that it cut short say OVER_BUDGET.
    """

    def __init__(
        self,
        arm: Arm,
        level: str = DEFAULT_LEVEL,
        *,
        budget_us: float | None = None,
        budget_work: int | None = None,
        clock: Clock | None = MONOTONIC,
        start: str = "maxima",
        k: int | None = None,
        seed: int = 0,
    ) -> None:
        check_arm(arm)
        seed = check_integer("seed", seed)
        if level not in LEVELS:
            raise ValueError(f"level must be one of {', '.join(LEVELS)}; got {level!r}")
        if start not in ("maxima", "random"):
            raise ValueError(f"start must be 'maxima' or 'random', got {start!r}")
        if k is not None and check_integer("k", k) < 1:
            raise ValueError(f"k must be at least 1, got {k}")
        if budget_work is not None and check_integer("budget_work", budget_work) < 0:
            raise ValueError(f"budget_work must not be negative, got {budget_work}")
        _check_budget(budget_us, clock)
        self.arm = arm
        self.allow(level)
        self.budget_us = budget_us
        self._budget_work = budget_work
        self._clock = clock
        layout = compile_layout(arm)
        self.neighbours = np.split(layout.edge_to, layout.edge_start[1:-1])
        """For each tactel those beside it, also across a seam: (n,) int each."""
        self._unit = length_unit(arm)
        # What a baseline changes from cycle to cycle: kernels see it through views they cannot write.
        self._sigma, self._limit = layout.sigma.copy(), layout.limit.copy()
        self._own_sigma, self._own_limit = layout.sigma, layout.limit
        self._layout = layout._replace(sigma=_read_only(self._sigma), limit=_read_only(self._limit))
        self._work = make_workspace(self._layout)
        self._search = make_search(self._layout)
        pitches = [placed.patch.pitch * placed.scale for placed in arm.patches]
        self._search.pitch[0] = np.median(pitches) / self._unit
        self._tables = array_table(self._layout), array_table(self._work), array_table(self._search)
        self._work.options[:] = (
            0 if k is None else min(k, PATCH_CLUSTERS),
            start == "random",
            0,
        )
        set_budget(self._work.work, arm.n_tactels, None, None, None)
        self._run(self._rank)
        self._work.random[0] = 1 + seed % 2147483646  # the generator's states are 1 ... 2^31 - 2

    def allow(self, level: str) -> None:
        """Let cycles have a higher level, whose kernels are compiled by now."""
        self.level, self._rank = level, LEVELS.index(level)

    def update(
        self,
        pressures: npt.ArrayLike,
        t_ns: int,
        valid: npt.ArrayLike | None = None,
        *,
        baseline: Baseline | None = None,
        level: str | None = None,
        budget_us: float | None = None,
    ) -> Contacts:
        """Return the contacts of one cycle.

        pressures: (n_tactels,) Pa, calibrated. NaN and infinity say nothing; full scale says "at least".
        t_ns:      time of the cycle.
        valid:     (n_patches,) or (n_tactels,), False where a reading is missing; None for all there.
        baseline:  the one that has just taken the zeros off these pressures. It says what is touched, with
                   hysteresis and by the noise it has measured; without one, what reaches the threshold is.
        level:     a cheaper one than that of the constructor, for this cycle.
        budget_us: another one than that of the constructor, for this cycle.

        Raises:
            TypeError: ``t_ns`` is no integer.
            ValueError: an array has the wrong shape; a time, a level or a budget that cannot be.
        """
        t_ns = check_time(t_ns)
        if np.shape(pressures) != (self.arm.n_tactels,):
            raise ValueError(f"pressures must have shape ({self.arm.n_tactels},), got {np.shape(pressures)}")
        if np.iscomplexobj(pressures):
            raise TypeError("pressures must be real numbers, got complex ones")
        if np.ma.is_masked(pressures) or np.ma.is_masked(valid):
            raise ValueError("pressures and valid must not be masked: say what is missing by `valid`")
        self._work.pressure[:] = pressures
        self._take_valid(valid)
        rank = self._rank
        if level is not None:
            rank = LEVELS.index(level) if level in LEVELS else len(LEVELS)
            if rank > self._rank:
                raise ValueError(f"level must be one of {', '.join(LEVELS[: self._rank + 1])}; got {level!r}")
        if budget_us is None:
            budget_us = self.budget_us
        else:
            _check_budget(budget_us, self._clock)
        set_budget(self._work.work, self.arm.n_tactels, self._clock, budget_us, self._budget_work)
        self._feel(baseline)
        self._run(rank)
        return Contacts.from_workspace(self._work, t_ns, self._unit)

    @property
    def n_evaluated(self) -> int:
        """Pressures that the fits of the last cycle have evaluated: its work."""
        return int(self._work.work[0])

    def _run(self, rank: int) -> None:
        self._work.options[RANK] = rank
        CYCLES[self._rank](*self._tables)

    def _feel(self, baseline: Baseline | None) -> None:
        """Write what each tactel feels; bring noise and limits to those of the baseline."""
        if baseline is None:
            self._sigma[:] = self._own_sigma
            self._limit[:] = self._own_limit
            # to FREE and TOUCHED
            self._work.felt[:] = self._work.pressure >= self._layout.threshold
            return
        if baseline.arm.n_tactels != self.arm.n_tactels:
            raise ValueError(
                f"the baseline is of {baseline.arm.name}, with other tactels than {self.arm.name}"
            )
        felt = baseline.felt
        # Never less than declared: readings that are too good do not make the law any truer.
        self._sigma[:] = np.maximum(np.sqrt(felt.variance + felt.doubt), self._own_sigma)
        # The zero is off the pressure, so full scale has moved by it.
        self._limit[:] = self._own_limit - felt.zero
        self._work.felt[:] = felt.touched

    def _take_valid(self, valid: npt.ArrayLike | None) -> None:
        n, m = self.arm.n_patches, self.arm.n_tactels
        flags = np.ones(m, np.bool_) if valid is None else np.asarray(valid, np.bool_)
        if flags.shape not in ((n,), (m,)):
            raise ValueError(f"valid must have shape ({n},) or ({m},), got {flags.shape}")
        self._work.valid[:] = flags[self.arm.tactel_patch] if len(flags) == n else flags


def _check_budget(budget_us: float | None, clock: Clock | None) -> None:
    if budget_us is None:
        return
    if not 0.0 <= budget_us < 1e12:
        raise ValueError(f"budget_us must be from 0 to 1e12 (eleven days), got {budget_us}")
    if clock is None:
        raise ValueError("budget_us needs a clock to be measured by")


def _read_only(column: Floats) -> Floats:
    view = column.view()
    view.setflags(write=False)
    return view


@kernel
def cycle_kmeans(lay: Layout, w: Work, q: Search) -> None:
    """Run a cycle of level ``kmeans``."""
    find_clusters(lay, w)


@kernel
def cycle_search(lay: Layout, w: Work, q: Search) -> None:
    """Run a cycle of any level."""
    rank = w.options[RANK]
    find_clusters(lay, w)
    if rank > 0:
        search_contacts(lay, w, q, rank > 1)


CYCLES = (cycle_kmeans, cycle_search, cycle_search)
"""By rank: ``kmeans`` runs before the search is compiled."""


@inner_kernel
def find_clusters(lay: Layout, w: Work) -> None:
    """Take the pressures of a cycle and write the contacts of level ``kmeans``."""
    begin(w)
    take_pressures(lay, w)
    subtract_offsets(lay, w)
    n_clusters = runtime_int(0)
    for patch in range(len(lay.patch_link)):
        if w.touched[patch]:
            n_clusters += cluster_patch(lay, w, patch, n_clusters, w.options[K], w.options[RANDOM] != 0)
    merge_clusters(lay, w, n_clusters)
    write_contacts(lay, w, n_clusters)


@inner_kernel
def take_pressures(lay: Layout, w: Work) -> None:
    """Copy the pressures, made finite and within full scale; note the state of each tactel."""
    state, active, held, start = w.state, w.active, w.held, lay.patch_start
    for patch in range(len(start) - 1):
        any_touched = False
        for i in range(start[patch], start[patch + 1]):
            p, limit = w.pressure[i], lay.limit[i]
            w.label[i] = -1
            active[i] = held[i] = False
            # a tactel whose zero is at full scale, or whose gain is 0, has nothing left to say
            if not (w.valid[i] and lay.healthy[i] and np.isfinite(p) and limit > 0.0):
                w.p[i] = 0.0
                state[i] = NO_VALUE
                continue
            state[i] = SATURATED if p >= limit else VALUE
            w.p[i] = min(max(p, -limit), limit) - lay.bias[i]
            # no branch: of tactels that nothing touches every second one reads more than nothing
            is_felt = (p > 0.0) & (w.felt[i] != FREE)
            active[i], held[i] = is_felt, is_felt & (w.felt[i] == HELD)
            any_touched |= is_felt
        w.touched[patch] = any_touched
