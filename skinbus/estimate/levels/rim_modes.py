"""Contacts of level ``fit`` at a rim, under a law held for true: the other place that explains the readings.

Beyond the outermost tactels a strong contact reads like a weak one within. A law with a misfit profile, or of
any size, says how likely either is (``posterior``); without these both are modes of the likelihood, and the
start of a fit decides which one it reaches. So the modes are searched as at level ``full``.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.constants import MAX_MOVE
from skinbus.estimate.kernels.groups import (
    add_background,
    group_contacts,
    list_tactels,
    load_group,
    rank_groups,
)
from skinbus.estimate.kernels.law import PROFILED, UNSIZED
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import MAX_ITERATIONS, OFF_SKIN, evaluate, fit
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.contact_shape import AT_RIM, open_side
from skinbus.estimate.levels.fit import say_over_budget, store_group
from skinbus.estimate.levels.modes import FEW_READINGS, blend, explore
from skinbus.estimate.levels.split_merge import own_nearest
from skinbus.jit import inner_kernel, runtime_int

SEARCH_SLACK = 0.01
"""Tactels a pitch (m) around the contacts are listed: the other place is that far off."""


@inner_kernel
def settle_rims(lay: Layout, w: Work) -> None:
    """Look for the other modes of all contacts at a rim that few tactels feel."""
    again, found = w.group_again, False
    for c in range(w.n_contacts[0]):
        law = lay.law_par[lay.law[lay.patch_start[w.patch[c]]]]
        again[c] = w.n_tactels[c] <= FEW_READINGS and law[PROFILED] == 0.0 and law[UNSIZED] == 0.0
        found |= again[c]
    if not found:
        return
    group_contacts(lay, w, 0.0, 0.0)
    for c in range(w.n_contacts[0]):
        again[w.group[c]] |= again[c]
    for o in range(rank_groups(w)):
        first = w.turn[o]
        if again[first]:
            k = load_group(w, first)
            settle_group(lay, w, first, k)
            if is_over(w):
                say_over_budget(w, k)


@inner_kernel
def settle_group(lay: Layout, w: Work, first: int, k: int) -> None:
    """Look for the other modes of the k contacts of a group, if one is at a rim; write the likeliest."""
    theta, link, is_open = w.theta, w.link[first], False
    n = list_tactels(lay, w, link, k, 0.0, SEARCH_SLACK, 0.0)
    for c in range(k):
        if w.n_tactels[w.members[c]] <= FEW_READINGS:
            out_s, out_a = open_side(lay, w, link, theta[c, 0], theta[c, 1], n, AT_RIM)
            is_open |= out_s != 0.0 or out_a != 0.0
    if not is_open or is_over(w):
        return
    add_background(lay, w, link, first, k, n)
    own_nearest(lay, w, link, k, n)
    chi2, _, _ = evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
    explore(lay, w, link, k, n, chi2)
    n = list_tactels(lay, w, link, k, 0.0, SEARCH_SLACK, 0.0)
    add_background(lay, w, link, first, k, n)
    own_nearest(lay, w, link, k, n)
    _, status, _ = fit(lay, w, link, k, n, MAX_MOVE, runtime_int(MAX_ITERATIONS), 0.0, math.inf)
    if status != OFF_SKIN and not is_over(w):
        store_group(lay, w, link, k, n, status, runtime_int(1))
        blend(lay, w, link, k, n)
