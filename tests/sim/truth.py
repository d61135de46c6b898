"""What the layer of a scene alone brings to its tactels."""

import numpy as np

from skinbus.sim.layer import Geometry


def truth_of(scene):
    """Return a function of the scene time (s) that returns pressures (n_tactels,) Pa, without any effect."""
    law = scene.layer.bind(Geometry.of(scene.arm, discs=scene.layer.discs), scene.plan.indenters)

    def pressures(t_s):
        found = np.zeros(scene.arm.n_tactels)
        law.add(scene.plan.load(t_s), found)
        return found

    return pressures
