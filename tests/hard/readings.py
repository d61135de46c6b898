"""The table of hard cases, second part: readings that are broken or extreme."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Quality
from skinbus.model import grid
from tests.hard.check import Case, Must, Situation
from tests.hard.ground import (
    FULL_SCALE,
    NOISE,
    PITCH,
    Ground,
    law_of,
    touch,
)
from tests.hard.places import ANY, PAPER, read

Floats = npt.NDArray[np.float64]

CELL: Final = 0.050**2 / 16
"""Skin that one tactel of the paper's board stands for, m^2."""
_ONE: Final = slice(16, 32)
_SMALLEST: Final = 5e-324


def _all(value: float | Callable[[int], Floats], ground: Ground) -> Situation:
    """Every tactel of every board reads this; what it comes from is undefined."""
    arm = ground.arm()
    n = arm.n_tactels
    return Situation(arm=arm, pressures=value(n) if callable(value) else np.full(n, value), touches=None)


def _nothing(ground: Ground) -> Situation:
    arm = ground.arm()
    return Situation(arm=arm, pressures=np.zeros(arm.n_tactels), touches=[])


def _some(readings: dict[int, float], ground: Ground) -> Situation:
    """Some tactels of one board read something that no contact makes; the others nothing."""
    arm = ground.arm()
    pressures = np.zeros(arm.n_tactels)
    for i, value in readings.items():
        pressures[16 + i] = value
    touches = [
        (0, float(arm.tactel_s[16 + i]), float(arm.tactel_a[16 + i]), math.nan) for i in readings
    ]  # of an unknown force
    return Situation(arm=arm, pressures=pressures, touches=touches)


def _pair(ground: Ground) -> Situation:
    """Two tactels read the same, the others nothing: by symmetry the touch is half way between them."""
    situation = _some({5: 5e3, 6: 5e3}, ground)
    (link, s1, a1, force), (_, s2, a2, _) = situation.touches or ()
    return replace(situation, touches=[(link, 0.5 * (s1 + s2), 0.5 * (a1 + a2), force)])


def _flat_board(value: float, ground: Ground) -> Situation:
    """One board alone, every tactel the same: a palm, or water."""
    arm = ground.board(grid(4, 4, PITCH))
    return Situation(arm=arm, pressures=np.full(16, value), touches=None, felt=16 * CELL * value)


def _noise_only(ground: Ground) -> Situation:
    arm = ground.arm()
    rng = np.random.default_rng(3)
    return Situation(arm=arm, pressures=NOISE * rng.standard_normal(arm.n_tactels), touches=[])


def _broken(readings: dict[int, float], ground: Ground) -> Situation:
    """A contact of 5 N, and some tactels of its board that read this instead."""
    arm = ground.arm()
    situation = read(arm, [touch(arm, 1, 0.002, 0.001, 5.0)])
    touches = list(situation.touches or [])
    for i, value in readings.items():
        situation.pressures[16 + i] = value
        if value >= FULL_SCALE:  # what it makes is no touch, yet stands where it is
            touches.append((0, float(arm.tactel_s[16 + i]), float(arm.tactel_a[16 + i]), 0.0))
    return replace(situation, touches=touches)


def _stuck_elsewhere(ground: Ground) -> Situation:
    arm = ground.arm()
    situation = read(arm, [touch(arm, 1, 0.002, 0.001, 5.0)])
    situation.pressures[48] = FULL_SCALE
    return replace(
        situation, touches=[*(situation.touches or []), (0, arm.tactel_s[48], arm.tactel_a[48], 0.0)]
    )


def _dead(dead: slice | list[int], ground: Ground) -> Situation:
    healthy = np.ones(16, np.bool_)
    healthy[dead] = False
    arm = ground.arm(healthy=healthy)
    touches = [touch(arm, 1, 0.002, 0.001, 5.0)] if healthy.any() else []
    situation = read(arm, touches)
    situation.pressures[~arm.tactel_healthy] = FULL_SCALE
    return situation


def _invalid_patch(ground: Ground) -> Situation:
    """The board under the contact sends nothing; its neighbours feel the skirt at most."""
    arm = ground.arm()
    situation = read(arm, [touch(arm, 1, 0.002, 0.001, 5.0)])
    return replace(situation, valid=np.arange(arm.n_patches) != 1)


def _negative(ground: Ground) -> Situation:
    arm = ground.arm()
    situation = read(arm, [touch(arm, 1, 0.002, 0.001, 5.0)])
    situation.pressures[situation.pressures == 0.0] = -100.0
    situation.pressures[64:] = -5e4
    return situation


def _saturated(share: float, ground: Ground) -> Situation:
    """A contact whose peak is this many times full scale."""
    arm = ground.arm(transducer=replace(ground.arm().patches[0].patch.transducer, full_scale=20e3))
    law = law_of(ground.law)
    force = float(law.force(share * 20e3, 0.0))
    return read(arm, [touch(arm, 1, 0.002, 0.001, force)])


def _clusters_of_paper(ground: Ground) -> Situation:
    """Every tactel a maximum: a chequerboard of contacts a pitch and a half apart."""
    arm = ground.arm()
    pressures = np.zeros(arm.n_tactels)
    row, column = np.divmod(np.arange(16), 4)
    pressures[_ONE] = np.where((row + column) % 2 == 0, 2e4, 0.0)
    return Situation(arm=arm, pressures=pressures, touches=None)


def _int16(n: int) -> Floats:
    return np.where(np.arange(n) % 2 == 0, 32767.0, -32768.0) * (FULL_SCALE / 32767.0)


USUAL: Final = Must(place=(PAPER, 1e-5, 1e-5), force=(1.5, 1e-3, 1e-3))
_SURE: Final = "fits exact, as if nothing were wrong"
_UNKNOWN: Final = Must(count=(0, 40))

READINGS: Final = (
    Case(
        name="no active tactel",
        why="empty lists everywhere",
        holds="no contact",
        must=Must(count=(0, 0)),
        build=_nothing,
    ),
    Case(
        name="noise alone",
        why="a 3 sigma tactel starts a fit",
        holds="no contact",
        must=Must(count=(0, 0)),
        build=_noise_only,
    ),
    Case(
        name="one active tactel",
        why="three unknowns, one reading; no contact makes it",
        holds="one contact within a pitch",
        must=Must(place=PITCH),
        build=partial(_some, {5: 5e3}),
    ),
    Case(
        name="two active tactels",
        why="three unknowns, two readings",
        holds="half way between them, within a pitch",
        must=Must(count=(1, 2), place=PITCH),
        build=_pair,
    ),
    Case(
        name="three in a row",
        why="collinear: across the row the place is that of its mirror image",
        holds="within a pitch and a half of each",
        must=Must(count=(1, 3), place=1.5 * PITCH),
        build=partial(_some, {4: 5e3, 5: 9e3, 6: 5e3}),
    ),
    *(
        Case(
            name=f"flat field of {value / 1e3:g} kPa",
            why="no place explains it: a palm, or water",
            holds="the force on the board within a factor of 4, or the law is said not to explain it",
            must=Must(count=(1, 16), force=(32.0, 3.0, 3.0)),
            build=partial(_flat_board, value),
        )
        for value in (2e3, 5e3, 20e3, 50e3)
    ),
    Case(
        name="flat field over the whole arm",
        why="all that is said, and no edge",
        holds="finite, on the skin",
        must=Must(count=(1, 40)),
        build=partial(_all, 20e3),
    ),
    Case(
        name="saturated in the middle",
        why="the readings that hold most are only lower bounds",
        holds="the fits still find place and force by the others",
        must=Must(place=(PAPER, 1e-3, 1e-3), force=(1.5, 0.05, 0.05), says=Quality.SATURATED),
        build=partial(_saturated, 2.5),
    ),
    Case(
        name="saturated four times over",
        why="only the rim of the contact is known",
        holds="one contact in place, flagged as saturated",
        must=Must(place=(2 * PITCH, PITCH, PITCH), says=Quality.SATURATED),
        build=partial(_saturated, 4.0),
    ),
    Case(
        name="all at full scale",
        why="only one-sided information: every stronger contact fits",
        holds="finite, said to be unsure",
        must=Must(count=(1, 40), says=ANY),
        build=partial(_all, FULL_SCALE),
    ),
    Case(
        name="one stuck at full scale",
        why="the strongest reading there is, and nothing around it",
        holds="the touch is found; under a cone the stuck one reaches it and says so",
        must=Must(count=(1, 2), place=(PITCH, 2e-3, 2e-3)),
        build=_stuck_elsewhere,
    ),
    Case(
        name="one stuck at full scale under the contact",
        why="it outweighs the contact",
        holds="what is off says so: within 6 of its own standard deviations",
        must=Must(count=(1, 3), place=(1.5 * PITCH, 2.5 * PITCH, 3.1 * PITCH)),
        build=partial(_broken, {0: FULL_SCALE}),
    ),
    Case(
        name="a dead row",
        why="no gradient across it",
        holds=_SURE,
        must=Must(place=(PITCH, 1e-5, 1e-5), force=(3.0, 1e-3, 1e-3)),
        build=partial(_dead, slice(4, 8)),
    ),
    Case(
        name="only two rows alive, apart",
        why="the touch is between them, 14 mm from both: a tactel at most feels it",
        holds="no contact with a small covariance that is not there",
        must=Must(count=(0, 2), place=2 * PITCH),
        build=partial(_dead, slice(4, 12)),
    ),
    Case(
        name="all dead",
        why="no reading is valid, though the values are large",
        holds="no contact",
        must=Must(count=(0, 0)),
        build=partial(_dead, slice(0, 16)),
    ),
    Case(
        name="the board sends nothing",
        why="its neighbours feel at most the skirt",
        holds="no contact with a small covariance that is not there",
        must=Must(count=(0, 1)),
        build=_invalid_patch,
    ),
    Case(
        name="negative after the baseline",
        why="a zero taken too high",
        holds="fits within 0.1 mm and 2 %",
        must=Must(place=(PAPER, 1e-4, 1e-4), force=(1.5, 0.02, 0.02)),
        build=_negative,
    ),
    Case(
        name="all negative",
        why="weights of a mean below zero",
        holds="no contact",
        must=Must(count=(0, 0)),
        build=partial(_all, -5e4),
    ),
    *(
        Case(
            name=f"all read {value:g}",
            why="the ends of the numbers",
            holds="no contact",
            must=Must(count=(0, 0)),
            build=partial(_all, value),
        )
        for value in (_SMALLEST, 1e-300, math.nan, math.inf, -math.inf, -1e300)
    ),
    Case(
        name="all read 1e+300",
        why="its square is infinite",
        holds="as full scale",
        must=Must(count=(1, 40), says=ANY),
        build=partial(_all, 1e300),
    ),
    *(
        Case(
            name=f"one reads {value:g}",
            why="beside a true contact",
            holds=_SURE,
            must=USUAL,
            build=partial(_broken, {0: value, 15: value}),
        )
        for value in (0.0, _SMALLEST, 1e-300, math.nan, math.inf, -math.inf)
    ),
    Case(
        name="a reading of NaN under the contact",
        why="the strongest tactel is missing",
        holds=_SURE,
        must=Must(place=(PITCH, 1e-5, 1e-5), force=(3.0, 1e-3, 1e-3)),
        build=partial(_broken, {10: math.nan}),
    ),
    Case(
        name="ends of the counts by turns",
        why="the most extreme pattern of 16-bit counts",
        holds="finite, on the skin",
        must=_UNKNOWN,
        build=partial(_all, _int16),
    ),
    Case(
        name="chequerboard",
        why="every tactel is a maximum",
        holds="finite, on the skin",
        must=Must(count=(1, 12)),
        build=_clusters_of_paper,
    ),
)
