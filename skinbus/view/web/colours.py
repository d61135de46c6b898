"""Colours of the page: pressure by a perceptual map, and the few colours that mean something.

The map is viridis, by N. Smith and S. van der Walt (CC0): equal steps of it look equal, also in grey and to
most who do not see all colours, and it has no red, which is that of faults.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bytes, Floats

Colours = Bytes
Colour = tuple[int, int, int]

_ANCHORS = np.frombuffer(
    bytes.fromhex(
        "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c"
        "1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725"
    ),
    np.uint8,
).reshape(-1, 3)
"""Seventeen of its colours, evenly spaced: linear between them is within 4 of 255 of the original."""

UNKNOWN: Colour = (148, 152, 158)
"""A tactel without a fresh reading: its pressure is not known, and is not shown as zero."""
LOST: Colour = (224, 49, 49)
"""A lost board, and a tactel that is not plausible."""
WAITING: Colour = (245, 159, 0)
"""Outline of a board that boots, is held, or is another device than the arm file asks for."""
CONTACT: Colour = (253, 126, 20)
COASTING: Colour = (255, 192, 120)
"""A contact that is not seen in this cycle."""
TRUTH: Colour = (214, 51, 190)
BODY: Colour = (206, 212, 218)
BOARD: Colour = (47, 52, 58)
ROBOT: Colour = (173, 181, 189)

FULL_KPA = 30.0
"""Brightest unless chosen otherwise, kPa: what a fingertip of 12 mm brings to a tactel with 8 N or so."""


def shades(pressures: Floats, full_pa: float = 1e3 * FULL_KPA) -> Colours:
    """Return the colours (n, 3) of pressures (n,) Pa; those beyond the ends of the map have its ends."""
    at, place = np.linspace(0.0, full_pa, len(_ANCHORS)), np.nan_to_num(pressures)
    return np.stack([np.interp(place, at, channel).round() for channel in _ANCHORS.T], -1).astype(np.uint8)


def gradient() -> str:
    """Return the map as a CSS gradient."""
    stops = ", ".join(f"rgb({r},{g},{b})" for r, g, b in _ANCHORS.tolist())
    return f"linear-gradient(to right, {stops})"


LIGHT = 1.2
"""Ambient light on surfaces, as a multiple of their colour: the brightest shade is nearly reached, and the
darkest have steps enough of the 255 that an instance has."""
_IN = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_OUT = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
_EXPOSURE = 1.0 / 0.6


def for_instances(shown: npt.ArrayLike, light: float = 1.0) -> Colours:
    """Return the colours (..., 3) of vertices and instances with which a browser shows these under a light.

    They are linear, and the renderer compresses light as film does; this is the inverse, as far as it goes.
    Source: three.js, tonemapping_pars_fragment (ACESFilmicToneMapping, by S. Hill).
    """
    return np.asarray(np.round(255.0 * _albedo(shown, light)), np.uint8)


def for_mesh(shown: Colour) -> Colour:
    """Return the colour (sRGB) of a mesh with which a browser shows this one in the light of the scene."""
    linear = _albedo(shown, LIGHT)
    gamma = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    red, green, blue = np.round(255.0 * gamma).astype(int).tolist()
    return red, green, blue


def _albedo(shown: npt.ArrayLike, light: float) -> Floats:
    srgb = np.asarray(shown, float) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    y = np.clip(linear @ np.linalg.inv(_OUT).T, 0.0, 0.98)
    a, b, c = 1.0 - 0.983729 * y, 0.0245786 - 0.4329510 * y, -0.000090537 - 0.238081 * y
    v = (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    return np.asarray(np.clip(v @ np.linalg.inv(_IN).T / (_EXPOSURE * light), 0.0, 1.0))
