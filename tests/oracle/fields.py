"""Pressure fields of touches, without the package's laws: the truth that estimates are held against."""

import numpy as np

DEPTH = 6e-3
DIAMETER = 9.53e-3


def cone_field(d, force, slope=1.2e6):
    """Pressure of the paper's cone at distances d (m), Pa."""
    height = (3.0 * force * slope**2 / np.pi) ** (1.0 / 3.0)
    return np.clip(height - slope * d, 0.0, None)


def elastic_field(d, force, depth=DEPTH, diameter=DIAMETER):
    """Mean pressure (Pa) over a disc whose centre lies d (m) from a point load, at a depth of a half-space.

    Boussinesq: p(r) = 3 F h^3 / (2 pi (r^2 + h^2)^(5/2)); the mean over the disc by Gauss quadrature.
    """
    x, wx = np.polynomial.legendre.leggauss(12)
    rho = 0.25 * diameter * (x + 1.0)
    angle = 2.0 * np.pi * (np.arange(24) + 0.5) / 24
    grid = np.linspace(0.0, 0.12, 1201)
    r2 = (
        grid[:, None, None] ** 2
        + rho[None, :, None] ** 2
        - 2.0 * grid[:, None, None] * rho[None, :, None] * np.cos(angle)[None, None, :]
    )
    k = 3.0 * depth**3 / (2.0 * np.pi * (r2 + depth**2) ** 2.5)
    ring = (k.mean(axis=2) * (wx * rho)).sum(axis=1) / (wx * rho).sum()
    return force * np.interp(d, grid, ring, right=0.0)


def pressures_of(arm, touches, field):
    """Pressures (n_tactels,) Pa of touches (s, a, force) on the first link of an arm; fields add."""
    surface = arm.links[0].surface
    return sum(field(surface.distance(s, a, arm.tactel_s, arm.tactel_a), force) for s, a, force in touches)
