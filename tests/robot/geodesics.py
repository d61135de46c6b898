"""Geodesics shot over smooth surfaces, by nothing that charts use, and the meshes of these surfaces."""

import numpy as np
from scipy.integrate import solve_ivp

from tests.robot.meshes import ellipsoid

EDGE = 3e-3
AXES = (0.09, 0.07, 0.06)


def slope_of_ellipsoid(axes):
    """Gradient of the implicit function of an ellipsoid, and its second derivatives."""
    squares = np.asarray(axes) ** 2
    return lambda x: (2.0 * x / squares, np.diag(2.0 / squares))


def shoot(slope, start, direction, length):
    """Where a geodesic from a place of an implicit surface is after this length."""

    def step(_, state):
        gradient, second = slope(state[:3])
        v = state[3:]
        return np.concatenate([v, -(v @ second @ v) / (gradient @ gradient) * gradient])

    found = solve_ivp(step, (0.0, length), np.concatenate([start, direction]), rtol=1e-10, atol=1e-12)
    return found.y[:3, -1]


SURFACES = {
    "sphere": (ellipsoid((0.08, 0.08, 0.08), EDGE), slope_of_ellipsoid((0.08, 0.08, 0.08))),
    "ellipsoid": (ellipsoid(AXES, EDGE), slope_of_ellipsoid(AXES)),
}
