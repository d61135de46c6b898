"""One cycle of the loads: sums of pressure times area over touched tactels and those within reach of them.

:mod:`skinbus.estimate.loads` says what they mean.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.workspace import FREE
from skinbus.jit import inner_kernel, kernel

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

FORCE, VARIANCE, S, A, PLACE, AREA, AREA_VARIANCE = range(7)
"""Columns of a row of loads: N, N^2, m, m, m^2, m^2, m^4."""
BORDER: Final = 1.0 / 12.0
"""Variance of the share of a cell that is pressed, at the border of what is touched: anything from 0 to 1."""
SHIFT: Final = 0.5
"""By how much the centre of a point is off when its force is off by its own size, in distances of tactels."""
FEATURES: Final = 7
"""Of a press: see :func:`_describe`."""
TERMS: Final = 1 + FEATURES + FEATURES * (FEATURES + 1) // 2
"""Of a polynomial of the second degree in them."""
LEAST_MOMENT: Final = 0.05
"""Squares of distances of tactels: a second moment below that of a press on one tactel contains no more."""
STRANGE: Final = 0.5
"""By how much the logarithm of the variance grows with a feature outside all examples, in its deviations."""
MOST: Final = 4.0
"""Largest logarithm of the variance and of a ratio: no example comes near."""


class Sums(NamedTuple):
    """Columns per tactel (n,), per patch (p,) and per link (l,)."""

    start: Ints  # (p + 1,)
    link: Ints  # (p,)
    patch: Ints  # (n,)
    period: Floats  # (p,) m, of the link
    centre_s: Floats  # (p,) m
    centre_a: Floats
    away_s: Floats  # (n,) m, from the centre of the patch
    away_a: Floats
    area: Floats  # (n,) m^2
    cell: Floats  # (n,) m^2
    spacing: Floats  # (p,) m, side of a cell
    wide: Floats  # (n,) logarithm of the cell over the square of the spacing
    rim: Bools  # (n,) there is no board beside it
    kind: Ints  # (p,) row of what is learned
    scale: Floats  # (kinds, 4, FEATURES) mean, deviation, least and largest of the features of examples
    learned: Floats  # (kinds, 2, TERMS) logarithms of force over sum, and of the variance of its error
    healthy: Bools  # (n,)
    near_start: Ints  # (n + 1,)
    near: Ints
    edge_start: Ints  # (n + 1,)
    edge: Ints
    summed: Bools  # (n,)
    variance: Floats  # (n,) Pa^2, of those that are summed
    root: Ints  # (p,) union-find: patches that one press may reach
    top: Ints  # (p,) of these the one with most of the force, at the root
    press: Floats  # (p, 10) of what is positive: sums of the force, its square, both times ``wide``, of the
    # square at rims, first and second moments about the centre of the patch; at the root those of the press
    features: Floats  # (p, FEATURES) of the press, at its root
    error: Floats  # (p, 2) force over sum, and the standard deviation of its error, at the root
    noise: Floats  # (p,) N^2
    parts: Floats  # (p, 10) sums of weight, its squares times variance (and s, a, both squared), weight times
    # s and a; of the force times both squared; variance of the centre by noise; weight times creep
    at_least: Bools  # (p,) a tactel is at full scale, or none is read: the load may be larger
    patches: Floats  # (p, 7)
    links: Floats  # (l, 7)
    total: Floats  # (7,)


@kernel
def integrate(
    w: Sums,
    pressures: Floats,
    touched: npt.NDArray[np.int8],
    valid: Bools,
    limit: Floats,
    noise: Floats,
    variance: Floats,
    doubt: Floats,
    zero: Floats,
    common: Floats,
    creep: Floats,
) -> None:
    """Run one cycle; noise as declared (Pa), the columns from variance on as the baseline has them."""
    n_patches = len(w.link)
    _zero(w)
    any_touched = False
    for i in range(len(pressures)):
        if _is_read(w, pressures, valid, i):
            w.at_least[w.patch[i]] = False
            if touched[i] != FREE:
                any_touched = True
                _take_around(w, pressures, valid, touched, i)
    if not any_touched:
        return
    for i in range(len(pressures)):
        if w.summed[i]:
            w.variance[i] = max(noise[i] * noise[i], variance[i] + doubt[i])
            _add(w, i, pressures, valid, limit[i] - zero[i])
            w.parts[w.patch[i], 9] += w.area[i] * creep[i]
    for p in range(n_patches):
        root = _find(w, p)
        if w.press[p, 0] > w.press[w.top[root], 0]:
            w.top[root] = p
    for p in range(n_patches):
        if w.root[p] != p and w.press[p, 0] > 0.0:
            _merge(w, p, w.root[p])
    for p in range(n_patches):
        if w.root[p] == p and w.press[p, 0] > 0.0:
            _describe(w, p)
    for p in range(n_patches):
        if w.parts[p, 0] > 0.0:
            _finish(w, p, common[p])
    _join(w)


@inner_kernel
def _zero(w: Sums) -> None:
    for i in range(len(w.summed)):
        w.summed[i] = False
    for p in range(len(w.link)):
        w.root[p] = w.top[p] = p
        w.noise[p] = w.error[p, 1] = 0.0
        w.error[p, 0] = 1.0
        for k in range(10):
            w.press[p, k] = 0.0
        w.at_least[p] = True
        for k in range(7):
            w.patches[p, k] = 0.0
        for k in range(10):
            w.parts[p, k] = 0.0
    for k in range(7):
        w.total[k] = 0.0
        for m in range(len(w.links)):
            w.links[m, k] = 0.0


@inner_kernel
def _is_read(w: Sums, pressures: Floats, valid: Bools, i: int) -> bool:
    return bool(valid[i] and w.healthy[i] and math.isfinite(pressures[i]))


@inner_kernel
def _find(w: Sums, p: int) -> int:
    while w.root[p] != p:
        w.root[p] = w.root[w.root[p]]
        p = w.root[p]
    return p


@inner_kernel
def _take_around(w: Sums, pressures: Floats, valid: Bools, touched: npt.NDArray[np.int8], i: int) -> None:
    """Mark what is within reach of a touched tactel, and join the patches."""
    p = w.patch[i]
    for e in range(w.near_start[i], w.near_start[i + 1]):
        w.summed[w.near[e]] = True
        q = w.patch[w.near[e]]
        if q != p:
            root, other = _find(w, p), _find(w, q)
            w.root[max(root, other)] = min(root, other)
    w.patches[p, AREA] += w.cell[i]
    for e in range(w.edge_start[i], w.edge_start[i + 1]):
        if touched[w.edge[e]] == FREE:
            w.patches[p, AREA_VARIANCE] += BORDER * w.cell[i] * w.cell[i]
            return


@inner_kernel
def _add(w: Sums, i: int, pressures: Floats, valid: Bools, limit: float) -> None:
    """Add a tactel to the sums of its patch."""
    p = w.patch[i]
    value, variance = pressures[i], w.variance[i]
    if not _is_read(w, pressures, valid, i):
        value, variance = _from_beside(w, pressures, valid, i)
    elif limit > 0.0 and value >= limit:
        w.at_least[p] = True
    area = w.area[i]
    known = area * area * variance
    s, a = w.away_s[i], w.away_a[i]
    w.patches[p, FORCE] += area * value
    w.patches[p, S] += area * value * s
    w.patches[p, A] += area * value * a
    w.parts[p, 0] += area
    w.parts[p, 1] += known
    w.parts[p, 2] += known * s
    w.parts[p, 3] += known * a
    w.parts[p, 4] += known * (s * s + a * a)
    w.parts[p, 5] += area * s
    w.parts[p, 6] += area * a
    w.parts[p, 7] += area * value * (s * s + a * a)
    force, row = max(area * value, 0.0), w.press[p]
    row[0] += force
    row[1] += force * force
    row[2] += force * w.wide[i]
    row[3] += force * force * w.wide[i]
    row[4] += force * force if w.rim[i] else 0.0
    row[5] += force * s
    row[6] += force * a
    row[7] += force * s * s
    row[8] += force * s * a
    row[9] += force * a * a


@inner_kernel
def _from_beside(w: Sums, pressures: Floats, valid: Bools, i: int) -> tuple[float, float]:
    """Return the mean of the neighbours of a tactel that is missing, and its variance: the mean squared."""
    total, n = 0.0, 0
    for e in range(w.edge_start[i], w.edge_start[i + 1]):
        if _is_read(w, pressures, valid, w.edge[e]):
            total += pressures[w.edge[e]]
            n += 1
    mean = total / max(n, 1)
    return mean, mean * mean


@inner_kernel
def _merge(w: Sums, p: int, root: int) -> None:
    """Add what a patch has of a press to that of the root, about whose centre the moments are."""
    row, to = w.press[p], w.press[root]
    x, y = w.centre_s[p] - w.centre_s[root], _around(w, p, w.centre_a[p] - w.centre_a[root])
    to[7] += row[7] + 2.0 * x * row[5] + x * x * row[0]
    to[8] += row[8] + x * row[6] + y * row[5] + x * y * row[0]
    to[9] += row[9] + 2.0 * y * row[6] + y * y * row[0]
    to[5] += row[5] + x * row[0]
    to[6] += row[6] + y * row[0]
    for k in range(5):
        to[k] += row[k]


@inner_kernel
def _describe(w: Sums, p: int) -> None:
    """Write the features of the press with this root, and what is learned of such: force over sum, its error.

    They are the logarithm of one over the number of tactels that share the press; how wide their cells are,
    and those of the strong ones; logarithms of both second moments, in distances of tactels; how much is at
    rims; the logarithm of the sum.
    """
    row, out, top = w.press[p], w.features[p], w.top[p]
    unit = 1.0 / (w.spacing[top] * w.spacing[top])
    total = row[0]
    x, y = row[5] / total, row[6] / total
    ss, sa, aa = row[7] / total - x * x, row[8] / total - x * y, row[9] / total - y * y
    middle = 0.5 * unit * (ss + aa)
    long = unit * math.sqrt(0.25 * (ss - aa) ** 2 + sa * sa)
    out[0] = math.log(row[1] / (total * total))
    out[1] = row[2] / total
    out[2] = row[3] / row[1]
    out[3] = math.log(max(middle + long, 0.0) + LEAST_MOMENT)
    out[4] = math.log(max(middle - long, 0.0) + LEAST_MOMENT)
    out[5] = row[4] / row[1]
    out[6] = math.log(total)
    k, strange, term = w.kind[top], 0.0, 1 + FEATURES
    scale, learned = w.scale[k], w.learned[k]
    at = row  # whose sums have been read
    for i in range(FEATURES):
        inside = min(max(out[i], scale[2, i]), scale[3, i])
        strange += abs(out[i] - inside) / scale[1, i]
        at[i] = (inside - scale[0, i]) / scale[1, i]
    ratio, variance = learned[0, 0], learned[1, 0]
    for i in range(FEATURES):
        ratio += learned[0, 1 + i] * at[i]
        variance += learned[1, 1 + i] * at[i]
        for m in range(i + 1):
            ratio += learned[0, term] * at[i] * at[m]
            variance += learned[1, term] * at[i] * at[m]
            term += 1
    w.error[p, 0] = math.exp(min(max(ratio, -MOST), MOST))
    w.error[p, 1] = math.exp(0.5 * min(max(variance + STRANGE * strange, -2.0 * MOST), MOST))


@inner_kernel
def _finish(w: Sums, p: int, common: float) -> None:
    """Make force, centre and variances of the sums of a patch."""
    force, row = w.patches[p, FORCE], w.parts[p]
    root = _find(w, p)
    ratio, share = w.error[root, 0], w.error[root, 1]
    w.noise[p] = row[1] + common * row[0] * row[0] + row[9] * row[9]
    w.noise[p] *= ratio * ratio
    w.patches[p, FORCE] = ratio * force
    unseen = share * ratio * abs(force)
    w.patches[p, VARIANCE] = w.noise[p] + unseen * unseen
    if not force > 0.0:
        w.patches[p, S], w.patches[p, A], w.patches[p, PLACE] = w.centre_s[p], w.centre_a[p], math.inf
        row[0] = unseen
        return
    s, a = w.patches[p, S] / force, w.patches[p, A] / force
    # of one tactel alone it is 0, less a rounding
    spread = max(row[4] - 2.0 * (s * row[2] + a * row[3]) + (s * s + a * a) * row[1], 0.0)
    together = common * ((row[5] - s * row[0]) ** 2 + (row[6] - a * row[0]) ** 2)
    w.patches[p, S], w.patches[p, A] = w.centre_s[p] + s, w.centre_a[p] + a
    row[7] = max(row[7] / force - s * s - a * a, 0.0)
    row[8] = 0.5 * (spread + together) / (force * force)  # along each axis
    w.patches[p, PLACE] = row[8] + _off_centre(share * share, w.spacing[p], row[7])
    row[0] = unseen


@inner_kernel
def _off_centre(share: float, spacing: float, moment: float) -> float:
    """Return the variance of a centre along each axis (m^2) where parts of a press are off by a share each.

    ``share`` is the square of that of the whole, ``moment`` the second about the centre, m^2; half of it is
    along each axis, and each part is off by twice the variance of the whole.
    """
    return share * ((SHIFT * spacing) ** 2 + moment)


@inner_kernel
def _join(w: Sums) -> None:
    """Sum the patches to links and the arm; one press on several patches is off by as much on all of them."""
    for m in range(len(w.links)):
        top = -1
        for p in range(len(w.link)):
            if w.link[p] == m and (top < 0 or w.patches[p, FORCE] > w.patches[top, FORCE]):
                top = p
        if top < 0 or not w.patches[top, FORCE] > 0.0:
            continue
        row = w.links[m]
        unseen, noise, moment = 0.0, 0.0, 0.0
        for p in range(len(w.link)):
            force = w.patches[p, FORCE]
            if w.link[p] != m or w.parts[p, 1] == 0.0:
                continue
            row[FORCE] += force
            row[VARIANCE] += w.noise[p]
            row[AREA] += w.patches[p, AREA]
            row[AREA_VARIANCE] += w.patches[p, AREA_VARIANCE]
            s, a = w.patches[p, S] - w.patches[top, S], _around(w, p, w.patches[p, A] - w.patches[top, A])
            row[S] += force * s
            row[A] += force * a
            noise += force * force * w.parts[p, 8]
            moment += force * (w.parts[p, 7] + s * s + a * a)
            if _find(w, p) == p:
                press = 0.0
                for q in range(p, len(w.link)):
                    if _find(w, q) == p:
                        press += w.parts[q, 0]
                unseen += press * press
        force = row[FORCE]
        row[VARIANCE] += unseen
        for k in (FORCE, VARIANCE, AREA, AREA_VARIANCE):
            w.total[k] += row[k]
        if not force > 0.0:
            row[PLACE] = math.inf
            continue
        s, a = row[S] / force, row[A] / force
        row[S], row[A] = w.patches[top, S] + s, _around(w, top, w.patches[top, A] + a)
        moment = max(moment / force - s * s - a * a, 0.0)
        row[PLACE] = noise / force**2 + _off_centre(unseen / force**2, w.spacing[top], moment)


@inner_kernel
def _around(w: Sums, p: int, a: float) -> float:
    """Return a place or a distance around the link of a patch, within half a turn, m."""
    if w.period[p] > 0.0:
        return float(a - w.period[p] * math.floor(a / w.period[p] + 0.5))
    return a
