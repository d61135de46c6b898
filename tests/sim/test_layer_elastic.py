"""The elastic layer against solutions that share no code with it."""

import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import j0, j1

from skinbus.sim.bonded_layer import STEP, profile, table, transfer

H = 6e-3
TACTEL = 9.53e-3 / 2


def solved_transfer(xi, *, thickness, poisson, tangential):
    """The layer by a 4 x 4 system of its boundary conditions, from the displacements of plane strain.

    Papkovich-Neuber's form of them (2 mu u, 2 mu w) for exp(+-q), q = xi z from the surface down, in mpmath.
    """
    mp = mpmath.mp.clone()
    mp.dps = 60
    nu, kappa = mp.mpf(poisson), 3 - 4 * mp.mpf(poisson)

    def field(q, sign):
        """Columns of (u, w, sigma, tau) / exp(sign q) for the harmonic and the q times harmonic solution."""
        s = mp.mpf(sign)
        # harmonic: u = -1, w = s (gradient of exp(s q) cos); sigma = 2 w', tau = u' - w
        harmonic = (-mp.mpf(1), s, mp.mpf(2), -2 * s)
        # q times harmonic (Papkovich-Neuber with B along z): u = -q, w = s q - kappa
        u, w = -q, s * q - kappa
        du, dw = -1 + s * u, s + s * w
        # lambda (div) / mu + 2 w';  div = u + w' (u ~ sin, differentiates to +u cos)
        lame = 2 * nu / (1 - 2 * nu)
        return harmonic, (u, w, lame * (u + dw) + 2 * dw, du - w)

    def columns(q):
        out = []
        for sign in (1, -1):
            for column in field(q, sign):
                out.append([value * mp.exp(sign * q) for value in column])
        return out

    top, base = (columns(mp.mpf(xi) * mp.mpf(z)) for z in (0, thickness))
    matrix = mp.matrix(4, 4)
    for k in range(4):
        matrix[0, k], matrix[1, k] = top[k][2], top[k][3]
        matrix[2, k], matrix[3, k] = base[k][0], base[k][1]
    c = mp.lu_solve(matrix, mp.matrix([0, -1, 0, 0] if tangential else [1, 0, 0, 0]))
    return float(sum(c[k] * base[k][2] for k in range(4)))


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.48, 0.4999])
@pytest.mark.parametrize("tangential", [False, True])
def test_transfer_satisfies_the_boundary_conditions_solved_one_by_one(poisson, tangential):
    xi = np.array([0.01, 1.0, 50.0, 200.0, 700.0, 3000.0])
    layer = {"thickness": H, "poisson": poisson, "tangential": tangential}
    wanted = [solved_transfer(x, **layer) for x in xi]
    assert_allclose(transfer(xi, **layer), wanted, rtol=1e-9, atol=1e-15)


def hankel(d, *, tactel, indenter, poisson=0.48):
    """k(d) by adaptive quadrature between the zeros of nothing at all: an independent integral."""

    def integrand(xi):
        x = xi * H
        n, kappa = 2 - 2 * poisson, 3 - 4 * poisson
        t = n * (n * math.cosh(x) + x * math.sinh(x)) / (n * n + kappa * math.sinh(x) ** 2 + x * x)
        for radius in (tactel, indenter):
            if radius > 0.0:
                t *= 2 * j1(xi * radius) / (xi * radius)
        return t * j0(xi * d) * xi

    pieces = np.linspace(1e-9, 40 / H, 60)
    return sum(quad(integrand, a, b, epsabs=1e-6, epsrel=1e-10)[0] for a, b in pairwise(pieces)) / math.tau


@pytest.mark.parametrize(("tactel", "indenter"), [(0.0, 0.0), (TACTEL, 0.0), (TACTEL, 4e-3), (TACTEL, 15e-3)])
def test_table_agrees_with_an_adaptive_hankel_integral(tactel, indenter):
    solved = table(thickness=H, poisson=0.48, tactel_radius=tactel, indenter_radius=indenter, reach=80e-3)
    d = np.array([0.0, 0.3, 1.0, 2.5, 4.77, 7.0, 10.0, 14.14, 20.0, 33.3, 60.0, 79.0]) * 1e-3
    wanted = np.array([hankel(x, tactel=tactel, indenter=indenter) for x in d])
    seen = np.interp(d, STEP * np.arange(len(solved)), solved)
    assert np.abs(seen - wanted).max() < 5e-5 * wanted[0]


@pytest.mark.parametrize("tangential", [False, True])
def test_layer_without_a_base_is_the_half_space_of_boussinesq_or_cerruti(tangential):
    z, d = 5e-3, np.linspace(0.0, 40e-3, 81)
    wanted = 3.0 * z**2 * (d if tangential else z) / (2.0 * math.pi * (d**2 + z**2) ** 2.5)
    given = profile(d, tangential=tangential, thickness=z, poisson=None)
    assert_allclose(given, wanted, atol=1e-10 * wanted.max())


@pytest.mark.parametrize("poisson", [0.3, 0.48])
def test_base_carries_the_whole_force(poisson):
    solved = table(thickness=H, poisson=poisson, tactel_radius=TACTEL, reach=150e-3)
    r = STEP * np.arange(len(solved))
    assert 2.0 * math.pi * np.trapezoid(r * solved, r) == pytest.approx(1.0, abs=1e-4)
