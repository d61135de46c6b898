"""Contacts fitted on the tactels that they reach, which are listed anew while contacts leave them."""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.board_places import onto_board
from skinbus.estimate.kernels.constants import MAX_MOVE
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.kernels.groups import FORCE_SLACK, PLACE_SLACK, add_background, list_tactels
from skinbus.estimate.kernels.law import PROFILED, UNSIZED
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import (
    CONVERGED,
    ITERATION_LIMIT,
    OFF_SKIN,
    ROUGH,
    evaluate,
    fit,
)
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.split_merge import clear_owners
from skinbus.jit import inner_kernel

REACHED, FEWEST = 3.0, 3
"""A tactel counts as reached if its pressure by the law is this many standard deviations; fewer reached than
this leave a place open."""
RELISTS = 3
"""A contact that leaves its tactels gets new ones this many times; at the start it is rarely a pitch off."""


@inner_kernel
def fit_listed(
    lay: Layout, w: Work, link: int, first: int, k: int, max_iterations: int
) -> tuple[int, float, int, bool]:
    """Fit k contacts in ``theta`` on the tactels they reach, listed anew while they leave them.

    One that ends off the board of the tactel nearest to it began off it, and goes on from there. Contacts
    that are solved again with their sizes need not arrive.

    Returns the number of tactels, chi^2, the status, and whether contacts outside press on those they reach.
    """
    n, chi2, status, is_profiled, is_sized = 0, 0.0, ITERATION_LIMIT, has_profile(lay), False
    for turn in range(RELISTS):
        n = list_tactels(lay, w, link, k, FORCE_SLACK, PLACE_SLACK, 0.0)
        add_background(lay, w, link, first, k, n)
        is_sized = is_unsized(lay, w, n)
        # the first weights of a law with a profile are those of a start: a search is enough
        rough = ROUGH if is_sized or (turn == 0 and is_profiled) else 0.0
        chi2, status, _ = fit(lay, w, link, k, n, MAX_MOVE, max_iterations, rough, math.inf)
        if status == OFF_SKIN:
            bring_back(lay, w, link, k, n)
            if is_over(w):
                break
        elif status != CONVERGED or (covered(lay, w, link, k) and (turn > 0 or not is_profiled)):
            break
    if is_sized and status == CONVERGED and not has_readings(lay, w, k):
        chi2, status, _ = fit(lay, w, link, k, n, MAX_MOVE, max_iterations, 0.0, math.inf)
    seen = False
    for c in range(k):
        for m in range(w.n_felt[c]):
            seen |= w.background[w.felt_at[c, m]] != 0.0
    return n, chi2, status, seen


@inner_kernel
def is_unsized(lay: Layout, w: Work, n: int) -> bool:
    """Return whether none of the n listed tactels has a law that was measured with what presses."""
    found = False
    for t in range(n):
        found |= lay.law_par[lay.law[w.list[t]], UNSIZED] == 0.0
    return not found


@inner_kernel
def has_readings(lay: Layout, w: Work, k: int) -> bool:
    """Return whether each of k contacts, as evaluated last, presses on more than ``FEWEST`` tactels."""
    for c in range(k):
        reached = 0
        for m in range(w.n_felt[c]):
            reached += w.felt[c, m, 3] > REACHED * lay.sigma[w.list[w.felt_at[c, m]]]
        if reached <= FEWEST:  # with the same number it may reach fewer where it arrives
            return False
    return True


@inner_kernel
def has_profile(lay: Layout) -> bool:
    """Return whether weights depend on where contacts are: the first are then those of a start."""
    found = False
    for law in range(len(lay.law_par)):
        found |= lay.law_par[law, PROFILED] != 0.0
    return found


@inner_kernel
def bring_back(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Bring k contacts in ``theta`` onto the boards of the listed tactels that are nearest to them."""
    surface, theta = surface_of(lay.link, link), w.theta
    for c in range(k):
        home, nearest = -1, math.inf
        for t in range(n):
            i = w.list[t]
            d = distance(surface, theta[c, 0], theta[c, 1], lay.s[i], lay.a[i])
            if d < nearest:
                home, nearest = lay.patch[i], d
        if home >= 0:
            onto_board(lay, link, home, theta[c])
    clear_owners(w, n)
    evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)


@inner_kernel
def covered(lay: Layout, w: Work, link: int, k: int) -> bool:
    """Return whether the fitted contacts still reach only tactels that were listed."""
    surface, theta, old = surface_of(lay.link, link), w.theta, w.listed_theta
    for c in range(k):
        d = distance(surface, theta[c, 0], theta[c, 1], old[c, 0], old[c, 1])
        if d + w.far[c] > w.far_listed[c]:
            return False
    return True
