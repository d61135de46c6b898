"""Arms that the estimator is tried on, built without arm files."""

import math
from dataclasses import replace

from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Surface


def forearm(law=None, *, rings=3, around=8, gaps=(0.0, 2e-3), pitch_around=51e-3, surface=None, **settings):
    """A cylinder with rings of the paper's board; ``gaps`` between rings, seams of 1 mm around (m)."""
    patch = replace(Patch.default(), law=law or Cone(), **settings)
    radius = around * pitch_around / math.tau
    surface = surface or Surface.cylinder(rings * 52e-3, radius)
    placed, s = [], 26e-3
    for ring in range(rings):
        for i in range(around):
            a = float(surface.wrap((i * math.tau / around) * surface.radius))
            placed.append(PlacedPatch(patch=patch, node_id=len(placed) + 1, link=0, s=s, a=a))
        s += 50e-3 + gaps[ring % len(gaps)]
    return Arm("forearm", [Link("forearm", surface)], placed)
