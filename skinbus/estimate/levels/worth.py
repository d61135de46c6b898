"""What the contacts are worth that one answer has beyond another: by chi^2, and by what a wrong law leaves.

Assumption: errors of a law are a few per cent of the pressures. Failure: two contacts nearer than half a
pitch look like a larger one.
Source: G. Schwarz, Estimating the dimension of a model (1978), for the form of the penalty.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.groups import weigh
from skinbus.estimate.kernels.law import MISFIT, PROFILED
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.least_squares import evaluate
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.estimate.levels.contact_width import GOOD
from skinbus.estimate.levels.listed_fit import has_profile
from skinbus.estimate.levels.split_merge import clear_owners
from skinbus.jit import inner_kernel

PENALTY = 25.0
"""chi^2: chance gives 25 to three parameters once in 6e4 cases, and there are some ten places to try."""
DOUBT = 0.03
"""Gains of a few per cent and the shape of a law must not make contacts."""
EXPLAINED = 0.15
"""Where noise does not explain what is left, contacts more must leave less than this part of it."""
WORTHLESS, MISSED, LIKELIER, PROVED = range(4)
"""What contacts more are worth: less than the penalty; that too, by a law that fits neither answer, while no
error of it is like what they explain; more, which a wrong law would also be; neither."""
SPARE_TACTELS = 2
"""Tactels beyond the number of parameters that an answer must also explain, before noise is all it leaves."""
SPREAD = 0.1
"""Part of what a law misfits that a tactel reads of others on its board: 1 % of the most that is read there.
Cross-talk of a board is 1 to 2 %; beside noise alone each row of tactels would be a touch."""
UNLIKE = 0.12
"""Root mean square of what a wrong law leaves, as a part of the pressures: a thumb of 25 mm leaves 9 %."""


@inner_kernel
def worth_more(
    lay: Layout, w: Work, link: int, few: Floats, k_few: int, many: Floats, k_many: int, n: int
) -> int:
    """Return what the contacts are worth that the answer ``many`` has beyond those of ``few``.

    Only the tactels for which they differ are asked. A richer answer that leaves noise is accepted for
    its chi^2, unless what a board's readings have of each other is worth as much. One that leaves more shows
    that the law is not true here: then it must explain most of what the other leaves, and that must be too
    much for an error of the law.
    """
    predicted, base, listed, weight = w.predicted, w.base, w.list, w.weight
    clear_owners(w, n)
    evaluate(lay, w, link, few, k_few, n, w.normal, w.gradient)
    for t in range(n):
        base[t] = predicted[t]
    evaluate(lay, w, link, many, k_many, n, w.normal, w.gradient)
    chi2_few, chi2_many, asked, gain, rest = 0.0, 0.0, 0, 0.0, 0.0
    strict, left, energy = 0.0, 0.0, 0.0
    for t in range(n):
        if (predicted[t] - base[t]) * (predicted[t] - base[t]) * weight[t] < 1.0:
            continue
        i = listed[t]
        asked += 1
        left_few, left_many = w.p[i] - base[t], w.p[i] - predicted[t]
        if w.state[i] == SATURATED:
            left_few, left_many = max(left_few, 0.0), max(left_many, 0.0)
        chi2_few += weight[t] * left_few * left_few
        chi2_many += weight[t] * left_many * left_many
        spread = spread_of(lay, w, i, n)
        even = 1.0 / (1.0 / weight[t] + spread * spread)
        gain += even * (left_few * left_few - left_many * left_many)
        rest += even * left_many * left_many
        misfit = lay.law_par[lay.law[i], MISFIT] * w.p[i]
        strict += left_many * left_many / (lay.sigma[i] * lay.sigma[i] + w.doubt[t] + misfit * misfit)
        left += left_few * left_few
        energy += w.p[i] * w.p[i]
    more = k_many - k_few
    freedom, needed = max(asked - 3 * more, 1), PENALTY * more
    is_unlike = left >= UNLIKE * UNLIKE * energy
    if chi2_few - chi2_many <= needed * max(1.0, chi2_many / freedom):
        return MISSED if is_unlike and chi2_few - chi2_many > needed else WORTHLESS
    if gain <= needed * max(1.0, rest / freedom):
        return LIKELIER
    spare = asked - 3 * (more + 1)
    if spare >= SPARE_TACTELS and strict <= spare + GOOD * math.sqrt(2.0 * spare):
        return PROVED
    if chi2_many <= EXPLAINED * chi2_few and is_unlike:
        return PROVED
    return LIKELIER


@inner_kernel
def spread_of(lay: Layout, w: Work, i: int, n: int) -> float:
    """Return the standard deviation (Pa) of what tactel i reads of the n listed that are on its board.

    The misfit of a law that was learned is a profile over distance, which has that in it.
    """
    laws, law, most = lay.law_par, lay.law[i], 0.0
    if laws[law, MISFIT] == 0.0 or laws[law, PROFILED] != 0.0:
        return 0.0
    for t in range(n):
        if lay.patch[w.list[t]] == lay.patch[i]:
            most = max(most, w.p[w.list[t]])
    return float(SPREAD * laws[law, MISFIT] * most)


@inner_kernel
def to_gain(lay: Layout, w: Work, link: int, k: int, n: int) -> float:
    """Return the most that chi^2 of the k contacts of ``best`` may be by the weights of any richer answer."""
    clear_owners(w, n)
    evaluate(lay, w, link, w.best, k, n, w.normal, w.gradient)
    most = 0.0
    for t in range(n):
        most += w.pull[t] * (w.p[w.list[t]] - w.predicted[t]) / (1.0 - w.doubt[t] * w.weight[t])
    return most


@inner_kernel
def reweigh(lay: Layout, w: Work, link: int, theta: Floats, k: int, n: int, chi2: float) -> float:
    """Give the tactels the weights of k contacts ``theta`` if weights depend on contacts; return chi^2 then.

    Answers are compared by the weights of the richer one: what one contact in place of two would leave by a
    misfit in proportion to its force explains itself.
    """
    if not has_profile(lay):
        return chi2
    weigh(lay, w, link, theta, k, n, DOUBT)
    clear_owners(w, n)
    return evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)[0]
