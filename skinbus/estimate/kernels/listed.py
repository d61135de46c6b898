"""The list of the tactels that contacts are solved on, with what loops over it read of each, side by side."""

from __future__ import annotations

from skinbus.estimate.kernels.geometry import separation, surface_of
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import Work
from skinbus.jit import inner_kernel

NEARLY_ROUND = 0.75
"""Part of the period that a place may be off the generator 0: a tactel is no further from it than one and a
quarter then, so that a difference is brought to half a period by one turn."""


@inner_kernel
def list_place(lay: Layout, w: Work, t: int, i: int) -> None:
    """Write tactel i to place t of the list."""
    w.list[t], w.listed_s[t], w.listed_a[t], w.listed_narrow[t] = i, lay.s[i], lay.a[i], lay.narrow[i]


@inner_kernel
def write_squares(lay: Layout, w: Work, link: int, s: float, a: float, n: int) -> None:
    """Write the squared distances (m^2) of the listed tactels from a place to ``square``."""
    surface, square, at_s, at_a = surface_of(lay.link, link), w.square, w.listed_s, w.listed_a
    period, half = surface.period, 0.5 * surface.period
    if surface.taper != 0.0 or (period > 0.0 and not abs(a) <= NEARLY_ROUND * period):
        for t in range(n):
            square[t] = separation(surface, s, a, at_s[t], at_a[t])[0]
        return
    for t in range(n):  # as ``separation`` does, several at once
        ds, da = s - at_s[t], a - at_a[t]
        da = da - period if da > half else da
        da = da + period if da < -half else da
        square[t] = ds * ds + da * da
