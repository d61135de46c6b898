"""The moves from one hypothesis to others: sizes, places, fewer contacts, more contacts.

Each move replaces up to two contacts of a hypothesis by up to two others. It is proposed only for contacts of
which the readings leave something open:

=======  =====================================================  ==============================================
move     proposes                                               for a contact
=======  =====================================================  ==============================================
sizes    the other kinds of size                                whose readings do not refute them
places   places around it, with the force that its nearest      that few tactels feel
         tactel then reads
fewer    to leave it out, its neighbour taking over;            whose force is uncertain;
         one in place of it and the nearest                     (all)
mirror   the two mirrored about the centre of their forces      of a hypothesis that few tactels feel
more     one more at the two largest residuals;                 (any hypothesis that misfits, or at ``full``)
         to divide it along the residuals, or across            beside residuals above noise
=======  =====================================================  ==============================================
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.board_places import keep_on_board
from skinbus.estimate.kernels.disc_shapes import KINDS, SPREADS
from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.kernels.law import amplitude, log_force_at, pressure
from skinbus.estimate.kernels.layout import OWN_SIZE, Layout
from skinbus.estimate.kernels.workspace import GROUP, Search, Work
from skinbus.estimate.search.evidence import (
    GIVE_UP,
    RIVAL,
    SIGNIFICANT,
    consider,
    misfit,
    nearest_contact,
    prepare,
)
from skinbus.estimate.search.least_squares import copy_contact, copy_contacts
from skinbus.estimate.search.model import feels
from skinbus.jit import inner_kernel

LARGE_RESIDUAL, ENOUGH_TACTELS = 3.0, 4
"""Standard deviations from which on a residual may be a contact. Tactels that a contact must bring to their
thresholds for its place to have one mode."""
AROUND, DIRECTIONS = 0.6, 5
"""Pitches from a contact at which other places are tried, outside its own mode and before the next tactel;
and their number: one is towards the nearest tactel."""
PER_CONTACT = 5
"""Tactels for each contact of a group: three or four unknowns, and one to spare. With fewer, no contact is
added, and pairs are mirrored."""
SPLITS = (0.5, 1.0)
"""Pitches from its place at which the halves of a divided contact start. With one of the two alone, errors of
pairs on a board of the paper are a third larger."""


@inner_kernel
def expand(lay: Layout, w: Work, q: Search, link: int, h: int, full: bool) -> None:
    """Fit what the moves propose from hypothesis h."""
    q.n_plans[0] = 0
    if q.dof[0] == 4:
        propose_sizes(q, h)
    propose_places(lay, q, link, h)
    if q.h_count[h] > 1:
        propose_fewer(lay, q, link, h)
    if (full or misfit(q, h) > 1.0) and q.h_chi2[h, 0] > SIGNIFICANT * SIGNIFICANT:
        prepare(lay, w, q, link, h)
        propose_more(lay, q, link, h)
    for move in range(q.n_plans[0]):
        k = q.plan[move, 2]
        copy_contacts(q.plan_theta[move], q.theta, k)
        for c in range(k):
            q.kind[c] = q.plan[move, 3 + c]
            q.theta[c, 1] = wrap(q.theta[c, 1], surface_of(lay.link, link).period)
            keep_on_board(lay, link, q.listed, q.n_listed[0], q.theta[c])
        for c in range(q.h_count[h]):
            if c != q.plan[move, 0] and c != q.plan[move, 1]:
                q.kind[k] = q.h_kind[h, c]
                copy_contact(q.h_theta[h, c], q.theta[k])
                k += 1
        consider(lay, w, q, link, k)


@inner_kernel
def propose(q: Search, gone: int, also: int) -> None:
    """Begin a proposal: contacts ``gone`` and ``also`` (-1 for none) go, those of :func:`put` come."""
    plan = q.plan[q.n_plans[0]]
    q.n_plans[0] += 1
    plan[0], plan[1], plan[2] = gone, also, 0


@inner_kernel
def put(q: Search, kind: int, s: float, a: float, log_force: float, size: float) -> None:
    """Add a new contact to the proposal begun last."""
    row = q.n_plans[0] - 1
    c = q.plan[row, 2]
    to = q.plan_theta[row, c]
    q.plan[row, 2], q.plan[row, 3 + c] = c + 1, kind
    to[0], to[1], to[2], to[3] = s, a, log_force, size


@inner_kernel
def propose_sizes(q: Search, h: int) -> None:
    """Propose other kinds of size for each contact, unless the readings refute them to first order.

    The fit less its prior is what the readings alone say, u ~ N(m, v). The evidence of a kind N(u_k, s_k^2)
    is then N(m; u_k, v + s_k^2), and place and force change with u by their covariance.
    """
    for c in range(q.h_count[h]):
        covariance, theta, here = q.h_covariance[h, c], q.h_theta[h, c], 0.0
        own, variance = q.h_kind[h, c], covariance[3, 3]
        spread = SPREADS[own] ** 2
        precision = max(1.0 / variance - 1.0 / spread, 1e-9)
        read = (theta[3] / variance - q.kind_mean[own] / spread) / precision
        for turn in range(KINDS + 1):
            kind = own if turn == 0 else turn - 1  # its own first: the others are compared with it
            if q.kind_share[kind] == 0.0 or (turn > 0 and kind == own):
                continue
            spread, off = SPREADS[kind] ** 2, read - q.kind_mean[kind]
            total = spread + 1.0 / precision
            score = math.log(q.kind_share[kind]) - 0.5 * (math.log(total) + off * off / total)
            if turn == 0:
                here = score
            elif score >= here - RIVAL:
                size = (precision * read + q.kind_mean[kind] / spread) / (precision + 1.0 / spread)
                by = (size - theta[3]) / variance
                s, a = theta[0] + by * covariance[0, 3], theta[1] + by * covariance[1, 3]
                propose(q, c, -1)
                put(q, kind, s, a, theta[2] + by * covariance[2, 3], size)


@inner_kernel
def propose_places(lay: Layout, q: Search, link: int, h: int) -> None:
    """Propose places around each contact that few tactels feel: other places explain their readings, too."""
    surface, laws, tables, away = surface_of(lay.link, link), lay.law_par, lay.law_table, AROUND * q.pitch[0]
    for c in range(q.h_count[h]):
        s, a, n_felt, home, nearest = q.h_theta[h, c, 0], q.h_theta[h, c, 1], 0, -1, math.inf
        law = lay.law[q.listed[0]]
        size, amp = laws[law, OWN_SIZE], amplitude(laws, law, q.h_theta[h, c, 2])[0]
        for t in range(q.n_listed[0]):
            i = q.listed[t]
            d = distance(surface, s, a, lay.s[i], lay.a[i])
            n_felt += pressure(laws, tables, law, amp, d, size)[0] >= lay.threshold[i]
            if d < nearest:
                home, nearest = i, d
        if n_felt >= ENOUGH_TACTELS:
            continue
        p = pressure(laws, tables, law, amp, nearest, size)[0]
        outward = math.atan2(wrap(a - lay.a[home], surface.period), s - lay.s[home])
        for turn in range(DIRECTIONS):
            angle = outward + 2.0 * math.pi * (turn + 0.5) / DIRECTIONS
            x, y = s + away * math.cos(angle), a + away * math.sin(angle)
            far = distance(surface, x, y, lay.s[home], lay.a[home])
            propose(q, c, -1)
            put(q, q.h_kind[h, c], x, y, log_force_at(laws, tables, law, p, far), q.h_theta[h, c, 3])


@inner_kernel
def propose_fewer(lay: Layout, q: Search, link: int, h: int) -> None:
    """Propose to leave out each contact, to merge it with the nearest, and to mirror the two.

    Where it is left out, the fit begins with the nearest as it is. Two contacts and their mirror image about
    the centre of their forces have the same sum, centre and spread of force: few tactels do not distinguish
    them.
    """
    k, theta, kind, period = q.h_count[h], q.h_theta[h], q.h_kind[h], surface_of(lay.link, link).period
    for c in range(k):
        e = nearest_contact(lay, link, theta, k, theta[c, 0], theta[c, 1], c)[0]
        if 2.0 * GIVE_UP * q.h_covariance[h, c, 2, 2] > 1.0:  # chi^2 grows by 1 / variance without it
            propose(q, c, e)
            put(q, kind[e], theta[e, 0], theta[e, 1], theta[e, 2], theta[e, 3])
        if e < c and nearest_contact(lay, link, theta, k, theta[e, 0], theta[e, 1], e)[0] == c:
            continue
        f0, f1 = math.exp(theta[c, 2]), math.exp(theta[e, 2])
        part, strongest = f1 / (f0 + f1), c if f0 >= f1 else e
        s, a = theta[e, 0] - theta[c, 0], wrap(theta[e, 1] - theta[c, 1], period)
        x, y = theta[c, 0] + part * s, theta[c, 1] + part * a
        propose(q, c, e)
        put(q, kind[strongest], x, y, math.log(f0 + f1), theta[strongest, 3])
        if q.h_chi2[h, 1] < PER_CONTACT * k:
            propose(q, c, e)
            put(q, kind[c], x + part * s, y + part * a, theta[c, 2], theta[c, 3])
            part -= 1.0
            put(q, kind[e], x + part * s, y + part * a, theta[e, 2], theta[e, 3])


@inner_kernel
def propose_more(lay: Layout, q: Search, link: int, h: int) -> None:
    """Propose a contact at each of the two largest residuals, and to divide contacts along the residuals.

    The hypothesis is the one prepared last. With ``GROUP`` contacts, or one per ``PER_CONTACT`` tactels, a
    new contact replaces the one of the least certain force, ``gone``.
    """
    surface, theta, last, gone = surface_of(lay.link, link), q.theta, -1, -1
    for c in range(q.h_count[h] if q.h_count[h] >= min(GROUP, q.n_listed[0] // PER_CONTACT) else 0):
        if gone < 0 or q.h_covariance[h, c, 2, 2] >= q.h_covariance[h, gone, 2, 2]:
            gone = c
    for _ in range(2):
        best, z_best = -1, LARGE_RESIDUAL
        for t in range(q.n_listed[0]):
            z = q.residual[t] / math.sqrt(q.variance[t])  # without tails, which would hide a contact
            if z > z_best and t != last and q.weight[t] > 0.0:
                best, z_best = t, z
        if best < 0:
            break
        i, last = q.listed[best], best
        log_force = log_force_at(lay.law_par, lay.law_table, lay.law[i], q.residual[best], 0.0)
        propose(q, gone, -1)
        put(q, q.kind[0], lay.s[i], lay.a[i], log_force, q.kind_mean[q.kind[0]])
    for c in range(q.h_count[h]):
        s, a, xx, xy, yy, chi2 = theta[c, 0], theta[c, 1], 0.0, 0.0, 0.0, 0.0
        for t in range(q.n_listed[0]):
            i, residual = q.listed[t], q.residual[t]
            x, y = lay.s[i] - s, wrap(lay.a[i] - a, surface.period)
            if feels(q, t, c) and q.weight[t] > 0.0:
                xx, xy, yy = xx + residual * x * x, xy + residual * x * y, yy + residual * y * y
                chi2 += residual * residual * q.weight[t] - 1.0
        if chi2 <= 0.0 or c == gone:  # noise alone explains what is left
            continue
        angle, half = 0.5 * math.atan2(2.0 * xy, xx - yy), theta[c, 2] - math.log(2.0)
        for turn in range(4):  # along the residuals and, since other contacts distort them, across
            part = SPLITS[turn % 2] * q.pitch[0]
            x, y = part * math.cos(angle), part * math.sin(angle)
            angle += 0.5 * math.pi if turn == 1 else 0.0
            propose(q, c, gone)
            put(q, q.kind[c], s + x, a + y, half, theta[c, 3])
            put(q, q.kind[c], s - x, a - y, half, theta[c, 3])
