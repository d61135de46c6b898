"""Colours of the page: pressure by a perceptual map, and the few colours that mean something.

The map is viridis, by N. Smith and S. van der Walt (CC0): equal steps of it look equal, also in grey and to
most who do not see all colours, and it has no red, which is that of faults.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

Colours = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

_ANCHORS: Final = np.array(
    [
        *[(68, 1, 84), (72, 24, 106), (71, 45, 123), (66, 64, 134), (59, 82, 139), (51, 99, 141)],
        *[(44, 114, 142), (38, 130, 142), (33, 145, 140), (31, 160, 136), (40, 174, 128), (63, 188, 115)],
        *[(94, 201, 98), (132, 212, 75), (173, 220, 48), (216, 226, 25), (253, 231, 37)],
    ],
    float,
)
"""Seventeen of its colours, evenly spaced: linear between them is within 4 of 255 of the original."""

UNKNOWN: Final[Colour] = (148, 152, 158)
"""A tactel without a fresh reading: its pressure is not known, and is not shown as zero."""
IMPLAUSIBLE: Final[Colour] = (224, 49, 49)
"""A tactel that is not plausible, and what crosses a lost board out."""
LOST: Final[Colour] = (224, 49, 49)
WAITING: Final[Colour] = (245, 159, 0)
"""Outline of a board that boots, is held, or is another device than the arm file asks for."""
CONTACT: Final[Colour] = (253, 126, 20)
COASTING: Final[Colour] = (255, 192, 120)
"""A contact that is not seen in this cycle."""
TRUTH: Final[Colour] = (214, 51, 190)
PUBLISHED: Final[Colour] = (21, 170, 191)
"""What was published when the recording was made."""
BODY: Final[Colour] = (206, 212, 218)
BOARD: Final[Colour] = (47, 52, 58)
BLIND: Final[Colour] = (240, 62, 62)

FULL_KPA: Final = 30.0
"""Brightest unless chosen otherwise, kPa: what a fingertip of 12 mm brings to a tactel with 8 N or so."""


def shades(pressures: npt.NDArray[np.float64], full_pa: float = 1e3 * FULL_KPA) -> Colours:
    """Return the colours (n, 3) of pressures (n,) Pa; those beyond the ends of the map have its ends."""
    place = np.clip(np.nan_to_num(pressures) / full_pa, 0.0, 1.0) * (len(_ANCHORS) - 1)
    low = np.minimum(place.astype(np.intp), len(_ANCHORS) - 2)
    share = (place - low)[:, None]
    return np.asarray(np.round((1.0 - share) * _ANCHORS[low] + share * _ANCHORS[low + 1]), np.uint8)


def palette(n_shades: int) -> Colours:
    """Return the middles of so many equal steps of the map, and the colour of what is not known, last."""
    middles = (np.arange(n_shades) + 0.5) / n_shades
    return np.concatenate([shades(middles, 1.0), np.array([UNKNOWN], np.uint8)])


def nearest(colours: Colours, shown: Colours) -> npt.NDArray[np.intp]:
    """Return the numbers (n,) of those of some colours (m, 3) that are nearest to others (n, 3)."""
    apart = shown[:, None].astype(np.int32) - colours
    return np.asarray((apart * apart).sum(-1).argmin(-1))


def gradient() -> str:
    """Return the map as a CSS gradient."""
    stops = ", ".join(f"rgb({r:.0f},{g:.0f},{b:.0f})" for r, g, b in _ANCHORS)
    return f"linear-gradient(to right, {stops})"


LIGHT: Final = 1.2
"""Ambient light on surfaces, as a multiple of their colour: the brightest shade is nearly reached, and the
darkest have steps enough of the 255 that an instance has."""
_IN: Final = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_OUT: Final = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_EXPOSURE: Final = 1.0 / 0.6


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


def _albedo(shown: npt.ArrayLike, light: float) -> npt.NDArray[np.float64]:
    srgb = np.asarray(shown, float) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    y = np.clip(linear @ np.linalg.inv(_OUT).T, 0.0, 0.98)
    a, b, c = 1.0 - 0.983729 * y, 0.0245786 - 0.4329510 * y, -0.000090537 - 0.238081 * y
    v = (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    return np.asarray(np.clip(v @ np.linalg.inv(_IN).T / (_EXPOSURE * light), 0.0, 1.0))
