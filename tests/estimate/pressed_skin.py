"""Plates of boards under an elastic layer, pressed by indenters that their law was not learned with."""

import numpy as np

from skinbus.model import Arm, Link, Patch, PlacedPatch, Radial, Surface, Transducer
from skinbus.model.patch import grid
from skinbus.sim.bonded_layer import profile
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads

BOARD, SEAM = 0.050, 0.001
NOISE = 200.0
LAYER = {"thickness": 6e-3, "poisson": 0.48}
LEARNED_WITH = 6e-3
"""Radius of the finger that the law is learned with, m."""

INDENTERS = {
    "palm": Indenter(Shape.PALM, 0.080, 0.060),
    "bar": Indenter(Shape.PALM, 0.040, 0.004),
    "edge": Indenter(Shape.PALM, 0.100, 0.030),
    "thumb": Indenter(Shape.DISC, 0.025),
    "tip": Indenter(Shape.DISC, 0.002),
    "four fingers": Indenter(Shape.DISC, 0.012),
}
FORCES = {"palm": 40.0, "bar": 15.0, "edge": 25.0, "thumb": 10.0, "tip": 5.0, "four fingers": 5.0}
"""N; fingers, each."""
FINGERS = 0.022 * np.array([-1.5, -0.5, 0.5, 1.5])
"""m, in a row."""


BOARDS = 4
"""Along each side of a plate."""


def make_plate(side, pitch):
    """Return an arm of boards of side x side tactels, on a plane."""
    diameter = min(9.53e-3, 0.95 * pitch)
    d = 0.75e-3 * np.arange(64)
    law = Radial(0.75e-3, profile(d, **LAYER, tactel_radius=0.5 * diameter, indenter_radius=LEARNED_WITH))
    patch = Patch(
        tactels_uv=grid(side, side, pitch),
        diameter=diameter,
        transducer=Transducer(full_scale=250e3, bits=16),
        law=law,
        threshold=1000.0,
        release=700.0,
        noise=NOISE,
    )
    size = BOARDS * (BOARD + SEAM)
    link = Link("plate", Surface.plane(size, size))
    middles = (np.arange(BOARDS) + 0.5) * (BOARD + SEAM)
    places = [(s, a - 0.5 * size) for s in middles for a in middles]
    placed = [PlacedPatch(patch=patch, node_id=k, link=0, s=s, a=a) for k, (s, a) in enumerate(places, 1)]
    return Arm("plate", [link], placed)


class Presses:
    """What an arm reads under indenters at random places of its first link, away from the ends."""

    def __init__(self, arm, name, seed):
        self.arm, self.name = arm, name
        self.rng = np.random.default_rng(seed)
        self._law = Elastic().bind(Geometry.of(arm, discs=True), [INDENTERS[name]])

    def read(self, force=None):
        """Return (n_tactels,) Pa with noise, the force (N), and the centre (s, a) m of a random press."""
        rng, surface = self.rng, self.arm.links[0].surface
        s, half = rng.uniform(0.055, surface.length - 0.055), 0.5 * surface.width - 0.055
        a, yaw = rng.uniform(-half, half), rng.uniform(0.0, np.pi)
        force = FORCES[self.name] * rng.uniform(0.5, 2.0) if force is None else force
        along = FINGERS if self.name == "four fingers" else np.zeros(1)
        loads = Loads(
            len(along),
            s=s + np.cos(yaw) * along,
            a=a + np.sin(yaw) * along,
            force=force,
            yaw=yaw,
            radius=0.5 * INDENTERS[self.name].length,
        )
        clean = np.zeros(self.arm.n_tactels)
        self._law.add(loads, clean)
        return (
            clean + NOISE * rng.standard_normal(self.arm.n_tactels),
            force * len(along),
            (float(s), float(a)),
        )
