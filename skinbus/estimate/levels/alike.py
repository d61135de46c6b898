"""Whether two answers with as many contacts are one: contact by contact, and by the information of a fit."""

from __future__ import annotations

import math

from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.listed_fit import has_profile
from skinbus.jit import inner_kernel

SAME = 0.3e-3
"""m: fits that end closer than this are on one mode."""
ON_ITS_WAY, ALIKE = 0.5 * SAME, 0.3
"""m; deviance, half a standard deviation: up to either, where a step leads is the top of a known mode."""
EVEN = 1.2
"""Two contacts of another answer whose matches exchanged are less than so many times as far may be either."""


@inner_kernel
def separate(lay: Layout, link: int, one: Floats, other: Floats) -> float:
    """Return the distance of two rows of tables of contacts, m."""
    return distance(surface_of(lay.link, link), one[0], one[1], other[0], other[1])


@inner_kernel
def match(lay: Layout, w: Work, link: int, k: int, ours: Floats, theirs: Floats) -> float:
    """Write to ``match`` which row of ``theirs`` is nearest to each of ``ours``, each taken once.

    Returns the largest distance of two that belong together, m.
    """
    matched, surface = w.match, surface_of(lay.link, link)
    most = 0.0
    for c in range(k):
        matched[c] = -1
    for _ in range(k):
        best, at, to = math.inf, 0, 0
        for c in range(k):
            if matched[c] >= 0:
                continue
            for e in range(k):
                taken = False
                for f in range(k):
                    taken = taken or matched[f] == e
                if taken:
                    continue
                d = distance(surface, ours[c, 0], ours[c, 1], theirs[e, 0], theirs[e, 1])
                if d < best:
                    best, at, to = d, c, e
        matched[at] = to
        most = max(most, best)
    return most


@inner_kernel
def interchangeable(
    lay: Layout, w: Work, link: int, k: int, ours: Floats, theirs: Floats, c: int, e: int
) -> bool:
    """Return whether row e of ``theirs`` is the match of row c of ``ours``, or may as well be.

    It may, if their matches exchanged are hardly further in sum: which is which is as open as all else.
    """
    own = w.match[c]
    if e == own:
        return True
    for f in range(k):
        if w.match[f] == e:
            matched = separate(lay, link, ours[c], theirs[own]) + separate(lay, link, ours[f], theirs[e])
            swapped = separate(lay, link, ours[c], theirs[e]) + separate(lay, link, ours[f], theirs[own])
            return bool(swapped < EVEN * matched)
    return False


@inner_kernel
def leads_to(lay: Layout, w: Work, link: int, k: int, top: Floats) -> bool:
    """Return whether the next step of the fit that has ended in ``theta`` leads to a top, or nearly.

    Near is ``ON_ITS_WAY``, or ``ALIKE`` by the information at ``theta``.
    """
    theta, ahead, off, normal = w.theta, w.trial, w.gradient_trial, w.normal
    for c in range(k):
        ahead[c, 0], ahead[c, 1] = theta[c, 0] + w.step[3 * c], theta[c, 1] + w.step[3 * c + 1]
    off_by = match(lay, w, link, k, ahead, top)
    if off_by < ON_ITS_WAY or has_profile(lay):  # weights of a start say nothing of those of its end
        return off_by < ON_ITS_WAY
    period, away = surface_of(lay.link, link).period, 0.0
    for c in range(k):
        e, u = w.match[c], 3 * c
        off[u], off[u + 1] = top[e, 0] - ahead[c, 0], wrap(top[e, 1] - ahead[c, 1], period)
        off[u + 2] = top[e, 2] - theta[c, 2] - w.step[u + 2]
    for u in range(3 * k):
        away += normal[u, u] * off[u] * off[u]
        for v in range(u):
            away += 2.0 * normal[u, v] * off[u] * off[v]
    return away < ALIKE
