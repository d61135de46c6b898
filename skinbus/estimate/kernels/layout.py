"""The arm as the kernels see it: flat read-only columns, the neighbourhood graph, the laws, compiled once.

Two tactels are neighbours unless a third sees them under more than ``SIGHT`` (a skeleton a little
denser than the Gabriel graph: for a grid, the eight tactels around one). A field that falls with
distance from one place has then a single local maximum, on any layout. Edges cross seams between
patches that lie side by side; the clustering of a patch uses only those within it.

Lengths in kernels are in units in which boards measure 25 to 100 mm: the unit is 1 m for every usual board, a
power of 4 of it where boards are smaller or larger. So the lengths among the estimator's constants, which are
those of a board of 50 mm with a pitch of 10 mm, fit boards of any size, and no digit is lost.

Source: D. Kirkpatrick, J. Radke, A framework for computational morphology (1985), beta-skeletons.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Floats, Ints
from skinbus.estimate.kernels.disc_shapes import (
    KINDS,
    LEARNED_SHARES,
    MODES,
    SHIPPED_SHARES,
    disc_shapes,
    learned_shapes,
)
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.jit import setup
from skinbus.model import Arm, Cone, Patch
from skinbus.model.bend import POWERS

SIGHT = math.radians(105.0)
"""Angle under which a third tactel sees two that are no neighbours: more than 90 degrees, so that diagonals
of a grid count; less than 120, so that no more do."""
SEAM = 5e-3
"""Patches further apart than this (m) are not side by side; seams of 0-2 mm are usual."""
CONE, RADIAL = 0.0, 1.0
"""Kinds of law."""
KIND, SLOPE, SCALE, POWER, REACH, REACH_PER, CORE, CORE_PER, PEAK = range(9)
"""Columns of ``law_par`` for a kernel of the law: its kind; slope of a cone, Pa/m; A = SCALE F^POWER; reach =
REACH + REACH_PER A and core = CORE + CORE_PER A, m; pressure at distance 0, per A."""
MISFIT, ROOT_MISFIT, TAILED, LOG_FORCE, FORCE_SD, SHAPED, OWN_SIZE, PER_STEP, LAST, SHARES = range(9, 19)
"""More columns: misfit as a share of a reading; its variance as a share of reading times amplitude; whether
it has tails; prior mean and standard deviation of log F; whether the law has modes by size; the u it was
measured with; 1 / step of its table; middle of the last step; from SHARES on, the prior share of each kind of
size."""
MISFIT_ROW = MODES + 1
"""Row of the misfit profile in ``law_table``; row 0 is k, those between are modes by size."""
GAINS = 0.37
"""Share of the misfit of a shipped law that gains cause. The rest is of sizes, which the search fits."""
SHIPPED_MODES = 0.006
"""Misfit that remains under a shipped law with sizes, as a share of its peak."""
LEARNED_MODES = 0.003
"""The same under a learned law, as a share of the root of peak times reading."""
SHIPPED_SD, LEARNED_SD, FLAT_SD = 1.5, 1.0, 6.0
"""Prior standard deviation of log F: of shipped laws, for usual boards are pressed with 1 to 18 N; of learned
laws, for forces are like those of the calibration; of laws without misfit, whose readings alone
determine the force."""
CORE_PART = 0.05
"""The core of a radial law ends where it falls to this share of its peak; beyond lies the skirt. Contacts
that overlap by skirts alone share some thousandths of their information, so they are solved one after the
other."""
USUAL_BOARD = 50e-3
"""m: the board for which the lengths among the constants are chosen."""


class Layout(NamedTuple):
    """Columns of an arm; see :class:`skinbus.model.Arm` for shapes and units; m is the arm's length unit."""

    s: Floats
    a: Floats
    x: Floats  # developed about the centre of the tactel's own patch, m
    y: Floats
    sigma: Floats  # noise of a reading with the rounding of its counts, Pa
    threshold: Floats
    limit: Floats  # pressure from which a tactel is at full scale, Pa; one of 0 or less has no value
    healthy: Bools
    patch: Ints
    law: Ints  # per tactel, an index of the law columns
    narrow: Floats  # 1 / width of the tactel's response
    bend: Floats  # (n_tactels, 9), see ``model.bend``; no rows where no chart of a mesh stretches
    bias: Floats  # Pa that the tactel reads too much
    map_of: Ints  # row of the tactel's map of residuals, -1 for none
    edge_start: Ints
    edge_to: Ints
    patch_start: Ints
    patch_link: Ints
    patch_s: Floats
    patch_a: Floats
    patch_reach: Floats  # (1,) furthest of any tactel from the centre of its patch, m
    board: Floats  # (n_patches, 4) cos and sin of yaw, half extents with a seam, m
    link: Floats  # (n_links, 4) radius, taper, period, length
    law_par: Floats  # (n_laws, SHARES + KINDS)
    law_table: Floats  # (n_laws, points, 24) 1/m^2, see ``kernels.law``
    map_value: Floats  # (n_maps, points, points) 1/m^2
    map_step: Floats  # (n_maps,) m


def compile_layout(arm: Arm) -> Layout:
    """Return the columns of an arm; the costly parts of the geometry are done here, once."""
    unit = length_unit(arm)
    patches = [placed.patch for placed in arm.patches]
    patch = arm.tactel_patch.astype(np.int64)
    law_par, law_table, law_of_patch = _distinct_laws(patches, unit)
    map_of, map_value, map_step = _maps(patches, unit)

    xy = []
    for p, placed in enumerate(arm.patches):
        here, surface = arm.tactels_of(p), arm.links[placed.link].surface
        xy.append(np.broadcast_arrays(*surface.develop(arm.tactel_s[here], arm.tactel_a[here], placed.a)))
    x, y = np.concatenate(xy, axis=1) / unit
    tactel_s, tactel_a = arm.tactel_s / unit, arm.tactel_a / unit
    patch_s, patch_a = arm.patch_s / unit, arm.patch_a / unit

    link = arm.patch_link.astype(np.int64)
    links = arm.link_shapes / (unit, 1.0, unit, unit)
    scale = np.array([[placed.scale] for placed in arm.patches])
    size = np.array([p.size for p in patches]) * scale / unit
    extent = np.stack([np.ptp(p.tactels_uv, axis=0) for p in patches]) * scale / unit
    margin = 0.5 * (size - extent).max(axis=1, initial=0.0)
    yaw = np.array([placed.yaw for placed in arm.patches])
    board = np.column_stack([np.cos(yaw), np.sin(yaw), 0.5 * size + SEAM])
    edges = _neighbours(tactel_s, tactel_a, patch, link, margin, links)
    edges |= edges.T

    columns = Layout(
        s=tactel_s,
        a=tactel_a,
        x=x,
        y=y,
        sigma=np.sqrt(arm.tactel_noise**2 + step_of(arm) ** 2 / 12.0),
        threshold=arm.tactel_threshold,
        limit=limit_of(arm),
        healthy=arm.tactel_healthy,
        patch=patch,
        law=law_of_patch[patch],
        narrow=1.0 / arm.tactel_width,
        bend=arm.tactel_bend * unit**POWERS,
        bias=arm.tactel_bias,
        map_of=map_of,
        edge_start=np.append(0, np.cumsum(edges.sum(axis=1))),
        edge_to=edges.nonzero()[1],
        patch_start=arm.patch_start.astype(np.int64),
        patch_link=link,
        patch_s=patch_s,
        patch_a=patch_a,
        patch_reach=np.hypot(x - patch_s[patch], y).max(keepdims=True),
        board=board,
        link=links,
        law_par=law_par,
        law_table=law_table,
        map_value=map_value,
        map_step=map_step,
    )
    return Layout._make(map(_frozen, columns))


def step_of(arm: Arm) -> Floats:
    """Return the step of the converter of each tactel, (n_tactels,) Pa; 0 where the gain is."""
    steps = np.array([placed.patch.transducer.resolution for placed in arm.patches])
    return np.asarray(steps[arm.tactel_patch] * np.abs(arm.tactel_gain))


def limit_of(arm: Arm) -> Floats:
    """Return the pressure from which each tactel is at full scale, (n_tactels,) Pa.

    That of the largest reading, less the counts at no pressure, less half a step: it stands for all that
    rounds to it, and arithmetic in another order does not bring it below by a bit.
    """
    transducers = [placed.patch.transducer for placed in arm.patches]
    full, step = np.array([(t.clipped_counts, t.step) for t in transducers])[arm.tactel_patch].T
    return np.asarray((full - arm.tactel_offset) * step * np.abs(arm.tactel_gain))


def length_unit(arm: Arm) -> float:
    """Return the length (m) that kernels count in on an arm: a power of 4.

    By the size of the boards, not by the distances of tactels: two that stand close do not make a fine board.
    """
    size = float(np.median([max(placed.patch.size) for placed in arm.patches]))
    return float(4.0 ** round(math.log(size / USUAL_BOARD, 4.0)))


def _distinct_laws(patches: list[Patch], unit: float) -> tuple[Floats, Floats, Ints]:
    """Return the columns of the distinct laws, and the index of each patch's law among them."""
    keys = [_key(patch) for patch in patches]
    order = list(dict.fromkeys(keys))
    first = [patches[keys.index(key)] for key in order]
    points = max(2, *(len(getattr(p.law, "table", ())) for p in first))
    par = np.zeros((len(first), SHARES + KINDS))
    table, slopes = np.zeros((2, len(first), MISFIT_ROW + 1, points))
    for i, patch in enumerate(first):
        law = patch.law
        row = {POWER: law.exponent, MISFIT: law.misfit, LOG_FORCE: _log_typical(patch), FORCE_SD: FLAT_SD}
        if isinstance(law, Cone):
            slope, height = law.slope * unit, np.cbrt(3.0 / math.pi) * np.cbrt(law.slope) ** 2
            row |= {KIND: CONE, SLOPE: slope, SCALE: height, POWER: law.exponent / 3.0, PEAK: 1.0}
            row |= {REACH_PER: 1.0 / slope, CORE_PER: 1.0 / slope}
        else:
            values, step = np.asarray(law.table, float), law.step / unit
            n, within = len(values), np.flatnonzero(np.abs(values) > CORE_PART * np.abs(values).max())[-1] + 1
            row |= {KIND: RADIAL, SCALE: 1.0, PEAK: values[0], PER_STEP: 1.0 / step, LAST: n - 1.5}
            # a law of one point is one tactel's
            row |= {REACH: step * max(n - 1.0, 0.5), CORE: step * min(within, n - 1)}
            table[i, 0, :n] = values
            if law.misfit_profile is not None:
                table[i, MISFIT_ROW, :n] = law.misfit_profile
                table[i, 1:MISFIT_ROW, :n], own_size = learned_shapes(law.step, values, 0.5 * patch.diameter)
                row |= {MISFIT: 0.0, ROOT_MISFIT: LEARNED_MODES**2 * values[0], TAILED: 1.0}
                # log F ~ N(f, sd^2) times 1 / F is N(f - sd^2, sd^2)
                row |= {LOG_FORCE: row[LOG_FORCE] - LEARNED_SD**2, FORCE_SD: LEARNED_SD}
                row |= {SHAPED: 1.0, OWN_SIZE: own_size}
                par[i, SHARES:] = LEARNED_SHARES
            elif law.misfit > 0.0:  # measured neither on its board nor with what presses it, and says so
                table[i, MISFIT_ROW, :n] = SHIPPED_MODES * values[0]
                table[i, 1:MISFIT_ROW, :n] = disc_shapes(law.step, values, 0.5 * patch.diameter)
                row |= {MISFIT: GAINS * law.misfit, FORCE_SD: SHIPPED_SD, SHAPED: 1.0}
                par[i, SHARES:] = SHIPPED_SHARES
            table[i, :, n:] = table[i, :, n - 1 : n]
            if n > 1:  # even in the distance: the slopes at 0 are 0
                slopes[i, :, 1:n] = np.gradient(table[i, :, :n], axis=-1)[:, 1:]
        par[i, list(row)] = list(row.values())
    return par, _by_point(table, slopes), np.array([order.index(key) for key in keys], np.int64)


def _log_typical(patch: Patch) -> float:
    """Return log F (N) of a usual contact.

    That of the calibration, or else its peak is the geometric mean of threshold and full scale.
    """
    typical = getattr(patch.law, "typical_force", 0.0)
    if typical > 0.0:
        return math.log(typical)
    full = patch.transducer.full_scale
    peak = math.sqrt(full * min(max(patch.threshold, 1e-6 * full), full))
    return math.log(max(float(patch.law.force(peak, 0.0)), 1e-20))


def _by_point(table: Floats, slopes: Floats) -> Floats:
    """Return (n_laws, rows, points) as what a kernel reads of one step, (n_laws, points, 4 rows).

    The columns of each row are its value, the rise to the next point, and the slopes at both.
    """
    after, slopes_after = (np.concatenate([x[:, :, 1:], x[:, :, -1:]], axis=2) for x in (table, slopes))
    columns = np.stack([table, after - table, slopes, slopes_after], axis=-1)
    return np.moveaxis(columns, 1, 2).reshape(*table.shape[::2], -1)


def _key(patch: Patch) -> tuple[object, ...]:
    law = patch.law
    columns = (np.asarray(getattr(law, field.name), float).tobytes() for field in fields(law))
    return (type(law), patch.diameter, *columns)


def _maps(patches: list[Patch], unit: float) -> tuple[Ints, Floats, Floats]:
    """Return the row of each tactel's map of residuals, the maps brought to one size, and their steps."""
    points = max([3, *(p.residual_map.values.shape[1] for p in patches if p.residual_map is not None)])
    row_of, values, steps = [], [np.zeros((1, points, points))], [1.0]  # of zeros, so that there is an array
    for p in patches:
        own = p.residual_map
        if own is None:
            row_of.append(np.full(p.n_tactels, -1))
            continue
        margin = (points - own.values.shape[1]) // 2
        values.append(np.pad(own.values, ((0, 0), (margin, margin), (margin, margin))))
        row_of.append(len(steps) + np.arange(p.n_tactels))
        steps += [own.step / unit] * p.n_tactels
    return np.concatenate(row_of).astype(np.int64), np.concatenate(values), np.array(steps)


def _frozen(column: npt.NDArray[Any]) -> npt.NDArray[Any]:
    column = np.array(column, order="C")  # one contiguous copy, so that every arm has the same kernel types
    column.setflags(write=False)
    return column


@setup
def _neighbours(s: Floats, a: Floats, patch: Ints, link: Ints, margin: Floats, links: Floats) -> Bools:
    """Return whether tactels are neighbours, (n, n): of one patch, or of two that touch but for a seam."""
    n = len(s)
    found, around, away = np.zeros((n, n), np.bool_), np.empty(n, np.int64), np.empty(n)
    for i in range(n):
        surface, n_around = surface_of(links, link[patch[i]]), 0
        for j in range(n):
            if link[patch[i]] == link[patch[j]]:
                d = distance(surface, s[i], a[i], s[j], a[j])
                most = math.sqrt(2.0) * (margin[patch[i]] + margin[patch[j]] + SEAM)  # corner to corner
                if patch[i] == patch[j] or d <= most:
                    around[n_around], away[n_around] = j, d
                    n_around += 1
        for u in range(n_around):
            j, free = around[u], around[u] != i
            for t in range(n_around):
                b = around[t]
                # within a patch only its own tactels stand between: its clusters do not depend on others
                if away[t] < away[u] and b != i and (patch[j] != patch[i] or patch[b] == patch[i]):
                    d = distance(surface, s[j], a[j], s[b], a[b])
                    between = away[t] * away[t] + d * d - 2.0 * away[t] * d * math.cos(SIGHT)
                    free &= between >= away[u] * away[u] * (1.0 - 1e-9)
                    if not free:
                        break
            found[i, j] = free
    return found
