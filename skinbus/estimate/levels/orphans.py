"""Touches that no contact explains.

Level ``full`` starts a contact where none reaches before it chooses their number. What is still left beyond
the cores of contacts, at ``fit`` and ``full``, flags the nearest.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.constants import BAD_FIT
from skinbus.estimate.kernels.covariance import PRIOR_LOG_FORCE, PRIOR_PLACE
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.kernels.law import KIND, affine, amplitude, core, log_force_of, peak_pressure, reach
from skinbus.estimate.kernels.layout import CONE, Layout
from skinbus.estimate.kernels.least_squares import LOG_FORCE_MAX, LOG_FORCE_MIN
from skinbus.estimate.kernels.workspace import OWNED, Work
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.estimate.levels.split_merge import ISOLATED
from skinbus.jit import inner_kernel, runtime_int

ORPHANS = 4
"""Contacts that a cycle takes up again; one is rare."""
PITCH = 0.012
"""m: nearer to a contact, what it leaves may be its law's fault."""
WIDEST, SKIRT = 0.02, 0.05
"""m from a contact, and the part of its peak that no finger makes there: a disc of 25 mm makes 2 %."""


@inner_kernel
def adopt_orphans(lay: Layout, w: Work) -> None:
    """Append a contact at every touched tactel that no contact reaches and that reads too much to be a foot.

    A merge across seams can be one too many; the fit then leaves one contact's tactels for the other's.
    """
    p, laws, last = w.p, lay.law_par, runtime_int(0)
    for _ in range(ORPHANS):
        n = w.n_contacts[0]
        if n == len(w.s):
            return
        orphan = -1
        for patch in range(len(lay.patch_link)):
            if not w.touched[patch]:
                continue
            link = lay.patch_link[patch]
            surface = surface_of(lay.link, link)
            for i in range(lay.patch_start[patch], lay.patch_start[patch + 1]):
                least = math.sqrt(EVIDENCE) * lay.sigma[i]
                if not w.active[i] or p[i] < least or (orphan >= 0 and p[i] <= p[orphan]):
                    continue
                alone = True
                for o in range(n):
                    c = (last + o) % n  # what reaches one tactel mostly reaches the next
                    if w.link[c] != link:
                        continue
                    d = distance(surface, w.s[c], w.a[c], lay.s[i], lay.a[i])
                    amp, _ = amplitude(laws, lay.law[i], w.log_force[c])
                    top = peak_pressure(laws, lay.law_table, lay.law[i], w.log_force[c])
                    if d < reach(laws, lay.law[i], amp) * w.width[c] or (d < ISOLATED and p[i] < OWNED * top):
                        alone, last = False, c
                        break
                if alone:
                    orphan = i
        if orphan < 0:
            return
        law = lay.law[orphan]
        g, h = affine(laws, lay.law_table, law, 0.0)
        w.s[n], w.a[n], w.width[n] = lay.s[orphan], lay.a[orphan], 1.0
        w.log_force[n] = min(max(log_force_of(laws, law, (p[orphan] - h) / g), LOG_FORCE_MIN), LOG_FORCE_MAX)
        w.link[n], w.patch[n] = lay.patch_link[lay.patch[orphan]], lay.patch[orphan]
        w.n_tactels[n], w.level[n], w.quality[n], w.status[n] = 1, 0, 0, 0
        w.residual[n], w.evidence[n] = 0.0, (p[orphan] / lay.sigma[orphan]) ** 2
        w.covariance[n] = 0.0  # that of the prior, in case that no time is left for a fit
        w.covariance[n, 0, 0] = w.covariance[n, 1, 1] = PRIOR_PLACE * PRIOR_PLACE
        w.covariance[n, 2, 2] = (PRIOR_LOG_FORCE * math.exp(w.log_force[n])) ** 2
        w.alive[n] = True
        w.n_contacts[0] = n + 1


@inner_kernel
def note_orphans(lay: Layout, w: Work) -> None:
    """Add to ``orphan`` the touched tactels that read too much to be on the skirt of any contact.

    Of each contact the strongest of those that it is nearest to. A cone has no skirts: what is beyond its
    foot is in the chi^2 of others, or a touch of its own.
    """
    p, laws, orphan, n, last = w.p, lay.law_par, w.orphan, w.n_contacts[0], runtime_int(0)
    for patch in range(len(lay.patch_link)):
        law = lay.law[lay.patch_start[patch]]
        if not w.touched[patch] or laws[law, KIND] == CONE:
            continue
        link = lay.patch_link[patch]
        surface = surface_of(lay.link, link)
        for i in range(lay.patch_start[patch], lay.patch_start[patch + 1]):
            if not w.active[i] or p[i] < math.sqrt(EVIDENCE) * lay.sigma[i]:
                continue
            nearest, least = -1, ISOLATED
            for o in range(n):
                c = (last + o) % n  # what reaches one tactel mostly reaches the next
                if w.link[c] != link:
                    continue
                d = distance(surface, w.s[c], w.a[c], lay.s[i], lay.a[i])
                foot = OWNED if d < WIDEST else SKIRT
                if d < max(core(laws, law, w.log_force[c]) * w.width[c], PITCH) or (
                    d < ISOLATED and p[i] < foot * peak_pressure(laws, lay.law_table, law, w.log_force[c])
                ):
                    nearest, last = -1, c
                    break
                if d < least:
                    nearest, least = c, d
            if nearest >= 0 and (orphan[nearest] < 0 or p[i] > p[orphan[nearest]]):
                orphan[nearest] = i


@inner_kernel
def doubt_unexplained(lay: Layout, w: Work, is_chosen: bool) -> None:
    """Flag the contacts nearest to readings that no contact explains.

    Two touches that are one cluster may be fitted as one of them, whose chi^2 does not contain the other.
    Unless the number of contacts ``is_chosen`` by level ``full``, so are those beside which one was proved
    that was not found.
    """
    for c in range(w.n_contacts[0] if is_chosen else 0):
        w.orphan[c] = -1
    note_orphans(lay, w)
    for c in range(w.n_contacts[0]):
        if w.orphan[c] >= 0:
            w.quality[c] |= BAD_FIT
