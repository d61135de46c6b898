"""Effects on when samples are taken, where the tactels are, how each responds, and how loads act on them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Rng, parameter, settings
from skinbus.sim.layer import Geometry, ResponseColumns

Mount = Callable[[Geometry], None]

PROFILE = np.array([[0.0, 1e-3, 5e-3, 8e-3, 12e-3, 20e-3, 30e-3], [0.0, 0.04, 0.22, 1.0, 0.65, 0.22, 0.0]])
"""Distance (m) and standard deviation of the residual as a share of its largest: measured on an array of
barometers under rubber, 9.9 mm apart; the ends are zero."""
N_WAVES = 24
"""Cosines that make up the smooth residual: its values are then normal within a few per cent."""


@settings
class SyncJitter(Effect):
    """The SYNC producer's timer is not exact: all patches sample at one wrong instant."""

    # a thread that waits for a timer on a desktop Linux wakes some 50 us to 1 ms late; cyclictest calls 100
    # us good
    sigma_us: float = parameter(200.0, "us", "standard deviation of the sampling instant", ge=0)

    def bind(self, arm: Arm, rng: Rng) -> Callable[[float], float]:
        """Return ``step(t_s) -> t_s``."""
        return lambda t_s: t_s + 1e-6 * self.sigma_us * rng.standard_normal()


@settings
class Misplaced(Effect):
    """Each patch is shifted along both directions of the surface and turned about its centre."""

    # poses of skin units found by touch or from accelerometers err by 1 to 2 mm (arXiv 2412.00672; notes of
    # Stepanova et al. on 50 to 100 poses)
    sigma_mm: float = parameter(1.0, "mm", "standard deviation of each shift", ge=0, le=50)
    sigma_deg: float = parameter(1.0, "deg", "standard deviation of the turn", ge=0, le=45)

    def bind(self, arm: Arm, rng: Rng) -> Mount:
        """Return ``step(geometry)``, which moves the tactels."""
        ds, da = 1e-3 * self.sigma_mm * rng.standard_normal((2, arm.n_patches))
        turn = np.radians(self.sigma_deg) * rng.standard_normal(arm.n_patches)

        def step(geometry: Geometry) -> None:
            for p, placed in enumerate(arm.patches):
                if not (ds[p] or da[p] or turn[p]):
                    continue
                surface, at = arm.links[placed.link].surface, arm.tactels_of(p)
                # on the flat development about the patch's own centre
                x, y = surface.develop(geometry.s[at], geometry.a[at], placed.a)
                x = x - placed.s
                cos, sin = np.cos(turn[p]), np.sin(turn[p])
                geometry.s[at], geometry.a[at] = surface.undevelop(
                    placed.s + cos * x - sin * y + ds[p], sin * x + cos * y + da[p], placed.a
                )

        return step


@settings
class Response(Effect):
    """Each tactel responds in its own way; the defaults are those of a real array of barometers under rubber.

    gain, width and ellipse change how a tactel responds to a load, ``residual`` is what no such number
    describes: a smooth random function of the place of the load, with a profile over distance that is largest
    where the load is beside the tactel. ``offset_pa`` is what it reads of no load.
    """

    # gains of that array differ by 6 to 11 %, widths by 3 to 5 %, ellipses have ratios up to 1.07, offsets
    # are 0.1 to 0.3 % of the peak of a firm press (100 kPa), and the residual is 0.9 % of the peak at 8 mm
    gain: float = parameter(0.10, "", "standard deviation of the gain about 1", ge=0, le=0.3)
    width: float = parameter(0.04, "", "standard deviation of the width about 1", ge=0, le=0.1)
    ellipse: float = parameter(1.03, "", "ratio of the axes of the response", ge=1, le=1.2)
    offset_pa: float = parameter(200.0, "Pa", "standard deviation of the reading of no load", ge=0)
    residual: float = parameter(0.009, "", "largest residual, as a share of the peak", ge=0, le=0.2)
    correlation_mm: float = parameter(8.0, "mm", "length over which it changes", gt=0, le=100)

    def bind(self, arm: Arm, rng: Rng) -> Mount:
        """Return ``step(geometry)``, which sets the responses of all tactels."""
        n = arm.n_tactels
        gain = 1.0 + self.gain * rng.standard_normal(n)
        width = np.maximum(1.0 + self.width * rng.standard_normal(n), 0.5)
        angle = rng.uniform(0.0, np.pi, n)
        offset = self.offset_pa * rng.standard_normal(n)
        # a Gaussian correlation exp(-x^2 / (2 L^2)) has normal wave numbers of deviation 1 / L
        waves = np.empty((n, N_WAVES, 3))
        waves[..., :2] = rng.standard_normal((n, N_WAVES, 2)) / (1e-3 * self.correlation_mm)
        waves[..., 2] = rng.uniform(0.0, 2.0 * np.pi, (n, N_WAVES))
        # axes of 1 / (width sqrt(ellipse)) and sqrt(ellipse) / width, turned by the angle
        axes = np.stack([np.stack([np.cos(angle), np.sin(angle)]), np.stack([-np.sin(angle), np.cos(angle)])])
        scale = np.stack([self.ellipse**-0.5 / width, self.ellipse**0.5 / width])
        shape = np.einsum("kn,kin,kjn->nij", scale, axes, axes)
        acts = self.gain > 0.0 or self.width > 0.0 or self.ellipse > 1.0 or self.residual > 0.0

        def step(geometry: Geometry) -> None:
            if self.offset_pa > 0.0:
                geometry.offset = offset
            if acts:
                geometry.response = ResponseColumns(
                    gain=gain,
                    shape=shape,
                    waves=waves[:, : N_WAVES if self.residual else 0].copy(),
                    residual=PROFILE * [[1.0], [self.residual]],
                )

        return step


@settings
class Shear(Effect):
    """Lets the ``inclination`` of touches act; points, discs and spheres.

    A push whose tangential force is below ``friction`` times the normal force sticks and has that force; one
    above slips and has ``friction`` times the normal force (Coulomb).
    """

    # dry skin on smooth polymers 0.3 to 1 (M. J. Adams et al., J. R. Soc. Interface 10, 20120467, 2013)
    friction: float = parameter(0.6, "", "coefficient between indenter and cover", ge=0, le=10)

    def bind(self, arm: Arm, rng: Rng) -> Mount:
        """Return ``step(geometry)``, which sets the friction."""

        def step(geometry: Geometry) -> None:
            geometry.friction = self.friction

        return step
