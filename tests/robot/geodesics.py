"""Geodesics shot over smooth surfaces, by nothing that charts use, and the meshes of these surfaces."""

import numpy as np
from scipy.integrate import solve_ivp

from tests.robot.meshes import ellipsoid, torus

EDGE = 3e-3
AXES = (0.09, 0.07, 0.06)
RINGS = 0.10, 0.05


def slope_of_ellipsoid(axes):
    """Gradient of the implicit function of an ellipsoid, and its second derivatives."""
    squares = np.asarray(axes) ** 2
    return lambda x: (2.0 * x / squares, np.diag(2.0 / squares))


def slope_of_torus(x):
    major = RINGS[0]
    rho = np.hypot(x[0], x[1])
    gradient = 2.0 * np.array([x[0] - major * x[0] / rho, x[1] - major * x[1] / rho, x[2]])
    flat, out = x[:2], np.zeros((3, 3))
    out[:2, :2] = 2.0 * (np.eye(2) * (1.0 - major / rho) + major * np.outer(flat, flat) / rho**3)
    out[2, 2] = 2.0
    return gradient, out


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
    "torus": (torus(*RINGS, EDGE), slope_of_torus),
}
