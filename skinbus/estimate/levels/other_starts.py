"""Answers of level ``fit`` from other starts, where the first leaves more than expected.

A start may be what the law of a stronger contact leaves on its skirts, and the mode that a fit has reached
need not be the only one.
"""

from __future__ import annotations

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import MAX_ITERATIONS, OFF_SKIN, evaluate
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.contact_width import expected
from skinbus.estimate.levels.listed_fit import fit_listed
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.estimate.levels.posterior import restart
from skinbus.estimate.levels.split_merge import clear_owners, copy_rows
from skinbus.jit import inner_kernel, runtime_int

WEAK = 0.1
"""Part of the readings of the strongest start of a group up to which a start may be what a law leaves."""
BETTER = 0.5
"""Part of chi^2 that an answer with fewer contacts may leave: where none explains the readings, all stay."""


@inner_kernel
def leave_out_weak(
    lay: Layout, w: Work, link: int, first: int, k: int, n: int, chi2: float, status: int, seen: bool
) -> tuple[int, int, float, int, bool]:
    """Fit the group without its weakest starts, one after the other; keep the first answer that is better.

    Beside a strong contact, what its law leaves makes weak starts; a joint fit may end where they press on
    each other's tactels. What a start left out reads counts as unexplained. Returns the number of contacts
    left in ``theta`` and ``members``, and what :func:`fit_listed` does.
    """
    theta, members, kept = w.theta, w.members, w.path
    copy_rows(theta, kept, k)
    limit = runtime_int(MAX_ITERATIONS)
    for c in range(1, k):  # strongest first
        to, e = members[c], c
        while e > 0 and w.evidence[members[e - 1]] < w.evidence[to]:
            members[e] = members[e - 1]
            for x in range(4):
                kept[e, x], kept[e - 1, x] = kept[e - 1, x], kept[e, x]
            e -= 1
        members[e] = to
    dropped = 0.0
    for few in range(k - 1, 0, -1):
        evidence = w.evidence[members[few]]
        if evidence > max(EVIDENCE, WEAK * WEAK * w.evidence[members[0]]) or is_over(w):
            break
        dropped += evidence
        for c in range(few):
            to = members[c]
            theta[c, 0], theta[c, 1], theta[c, 2], theta[c, 3] = (
                w.s[to],
                w.a[to],
                w.log_force[to],
                w.width[to],
            )
        n_few, chi2_few, status_few, seen_few = fit_listed(lay, w, link, first, few, limit)
        if status_few != OFF_SKIN and chi2_few + dropped < BETTER * chi2:
            return few, n_few, chi2_few, status_few, seen_few
    copy_rows(kept, theta, k)
    n, chi2, status, seen = fit_listed(lay, w, link, first, k, limit)
    return k, n, chi2, status, seen


@inner_kernel
def try_again(
    lay: Layout, w: Work, link: int, first: int, n: int, chi2: float
) -> tuple[int, float, int, bool]:
    """Fit the one contact in ``theta`` from the likeliest cell around it, too; leave the better of the two.

    What does not fit may be another mode, before it is a wider contact. Returns what :func:`fit_listed` does.
    """
    kept = w.before
    copy_rows(w.theta, kept, 1)
    clear_owners(w, n)
    evaluate(lay, w, link, w.theta, 1, n, w.normal, w.gradient)
    limit = runtime_int(MAX_ITERATIONS)
    if restart(lay, w, link, runtime_int(0), n):
        n, other, status, seen = fit_listed(lay, w, link, first, 1, limit)
        if other <= max(chi2, expected(1, n)) and status != OFF_SKIN:
            return n, other, status, seen
    copy_rows(kept, w.theta, 1)
    return fit_listed(lay, w, link, first, 1, limit)
