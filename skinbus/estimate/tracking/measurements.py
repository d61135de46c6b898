"""Contacts as measurements of tracks: which can be used, and how far each is to be trusted."""

from __future__ import annotations

import math

import numpy as np

from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.tracking import state as k
from skinbus.estimate.tracking.state import Floats, Ground, TrackWork
from skinbus.jit import inner_kernel

A_FLOOR = 0.05
"""Least scale of a on a cone, towards its tip: a stays an arc length that can be divided by."""
FAR = 1e3
"""Places (m) and forces (times 1e6, N) beyond this are no contacts."""


@inner_kernel
def check_contacts(w: TrackWork, g: Ground, n: int) -> None:
    """Note which contacts can be used, and give each a covariance that is regular."""
    for j in range(n):
        w.c_track[j] = -1
        s, a, force = w.c_z[j, 0], w.c_z[j, 1], w.c_z[j, 2]
        ok = abs(s) < FAR and abs(a) < FAR and 0.0 <= force < 1e6 * FAR  # false for NaN
        w.c_usable[j] = ok and 0 <= w.c_link[j] < len(g.link) and 0 <= w.c_patch[j] < len(g.patch_s)
        if w.c_usable[j]:
            _regularise(w.c_cov[j], force, scale_of_a(g, w.c_link[j], s))


@inner_kernel
def _regularise(R: Floats, force: float, scale: float) -> None:
    """Bring the covariance R (3, 3) between floor and ceiling; replace one that says nothing."""
    known = True
    for i in range(3):
        known = known and 0.0 < R[i, i] < np.inf
        for j in range(3):
            known = known and math.isfinite(R[i, j])
    if not known:
        for i in range(3):
            for j in range(3):
                R[i, j] = 0.0
        R[0, 0] = k.SIGMA_UNKNOWN**2
        R[1, 1] = (k.SIGMA_UNKNOWN / scale) ** 2
        R[2, 2] = (k.FORCE_UNKNOWN * force + 0.05) ** 2
        return
    for i in range(3):
        least, most = k.SIGMA_FLOOR, k.SIGMA_CEILING
        if i == 1:
            least, most = least / scale, most / scale
        elif i == 2:
            least, most = k.FORCE_FLOOR * (force + 1.0), force + 1.0
        old = math.sqrt(R[i, i])
        new = min(max(old, least), most)
        for j in range(3):
            if i != j:
                R[i, j] *= new / old
                R[j, i] *= new / old
        R[i, i] = new * new
    for i in range(3):
        for j in range(i):
            r = 0.5 * (R[i, j] + R[j, i]) / math.sqrt(R[i, i] * R[j, j])
            r = min(max(k.CORRELATION_LIMIT * r, -k.CORRELATION_LIMIT), k.CORRELATION_LIMIT)
            R[i, j] = R[j, i] = r
    c01, c02, c12 = R[1, 0], R[2, 0], R[2, 1]
    if 1.0 - c01 * c01 - c02 * c02 - c12 * c12 + 2.0 * c01 * c02 * c12 < 1e-6:
        c01 = c02 = c12 = 0.0  # correlations that contradict each other
    R[1, 0] = R[0, 1] = c01 * math.sqrt(R[0, 0] * R[1, 1])
    R[2, 0] = R[0, 2] = c02 * math.sqrt(R[0, 0] * R[2, 2])
    R[2, 1] = R[1, 2] = c12 * math.sqrt(R[1, 1] * R[2, 2])


@inner_kernel
def mark_crowded(w: TrackWork, g: Ground, n: int) -> None:
    """Trust contacts less that are near others: their errors are common, and no covariance says so."""
    for j in range(n):
        w.c_crowded[j] = False
        if not w.c_usable[j]:
            continue
        link, near = w.c_link[j], 0
        for i in range(k.MAX_TRACKS):
            here = w.identity[i] and w.state[i] != k.LIFT and w.link[i] == link
            if here and abs(w.x[i, 0] - w.c_z[j, 0]) <= k.CROWD:
                d = distance_on(g, link, w.x[i, 0], w.x[i, 1], w.c_z[j, 0], w.c_z[j, 1])
                near += d <= k.CROWD
        if near > 1:
            w.c_crowded[j] = True
            scale = scale_of_a(g, link, w.c_z[j, 0])
            w.c_cov[j, 0, 0] += k.SIGMA_CROWD**2
            w.c_cov[j, 1, 1] += (k.SIGMA_CROWD / scale) ** 2
            w.c_cov[j, 2, 2] += (k.FORCE_CROWD * w.c_z[j, 2]) ** 2


@inner_kernel
def scale_of_a(g: Ground, link: int, s: float) -> float:
    """Return metres on the surface per metre of a."""
    surface = surface_of(g.link, link)
    r = surface.radius + surface.taper * (s - 0.5 * surface.length)
    return float(max(r / surface.radius, A_FLOOR))


@inner_kernel
def distance_on(g: Ground, link: int, s1: float, a1: float, s2: float, a2: float) -> float:
    """Return the geodesic distance of two places on a link, m."""
    return float(distance(surface_of(g.link, link), s1, a1, s2, a2))
