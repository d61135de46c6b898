"""The table of hard cases, first part: where and how hard something touches, under which law."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Quality
from skinbus.model import Arm, Cone, Law, Radial, grid
from tests.hard.check import Case, Must, Situation
from tests.hard.ground import (
    NOISE,
    PITCH,
    THRESHOLD,
    Ground,
    Touch,
    place,
    pressures_under,
    surface_of,
    touch,
)

Floats = npt.NDArray[np.float64]
Build = Callable[[Ground], Situation | None]

ONE: Final = 1
"""The patch most cases press on; its neighbours around are 0 and 2."""
HALF: Final = 0.5 * PITCH
EDGE: Final = 0.0255
"""From the centre of a board to the middle of the seam around it, m."""
PAPER: Final = 4e-3
"""m: the most that K-means is off inside a board."""
FAR_OFF: Final = 12e-3
"""m: the outer tactels of two boards are 21 mm apart, and K-means answers with one of them."""
ANY: Final = Quality(63)


def press(*spots: tuple[float, float, float], patch: int = ONE, noise: float = 0.0, name: str = "") -> Build:
    """Return what builds touches (u, v, force) on a board, read with noise (Pa)."""

    def build(ground: Ground) -> Situation:
        arm = ground.arm()
        return read(arm, [touch(arm, patch, *spot) for spot in spots], noise, name)

    return build


def read(
    arm: Arm,
    touches: Sequence[Touch],
    noise: float = 0.0,
    name: str = "",
    truth: Sequence[Touch] | None = None,
) -> Situation:
    """Return what an arm reads of touches; ``truth`` where they count as something else."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    pressures = pressures_under(arm, touches) + noise * rng.standard_normal(arm.n_tactels)
    limit = np.repeat([p.patch.transducer.full_scale for p in arm.patches], np.diff(arm.patch_start))
    return Situation(
        arm=arm, pressures=np.minimum(pressures, limit), touches=touches if truth is None else truth
    )


def _twins(apart: float, ground: Ground) -> Situation:
    """Two contacts of 5 N so near that they count as one of 10 N."""
    arm = ground.arm()
    link, s, a, force = touch(arm, ONE, 0.002, 0.001, 5.0)
    one = touch(arm, ONE, 0.002 + apart, 0.001, 5.0)
    return read(arm, [(link, s, a, force), one], truth=[(link, s, a, 10.0)])


def _on_wrap(s: float, ground: Ground) -> Situation | None:
    surface = surface_of(ground.surface)
    if surface.period == 0.0:
        return None
    arm = ground.arm()
    return read(arm, [(0, s, 0.5 * surface.period, 60.0)])


def _null_zone(share: float, ground: Ground) -> Situation:
    """Between four tactels, with a force that brings them to ``share`` of their threshold."""
    arm = ground.arm()
    d = math.hypot(HALF, HALF)
    force = float(arm.patches[ONE].patch.law.force(share * THRESHOLD, d))
    return read(arm, [touch(arm, ONE, 0.0, 0.0, force)])


def _drop_off(slope: float, ground: Ground) -> Situation | None:
    """A cone of any slope, right on a tactel, with a peak of 20 kPa."""
    if ground.law != "cone":
        return None
    law = Cone(slope)
    arm = ground.arm(law)
    force = math.pi * 20e3**3 / (3.0 * slope**2)
    return read(arm, [touch(arm, ONE, HALF, HALF, force)])


def _wider_than_the_arm(ground: Ground) -> Situation:
    """The base of the contact is a metre, as in the paper's section VII-B."""
    law: Law = Cone(1e5)
    if ground.law == "radial":
        law = Radial(20e-3, np.linspace(1.0, 0.0, 51))
    arm = ground.arm(law)
    force = float(law.force(100e3, 0.0))
    return read(arm, [touch(arm, ONE, 0.002, 0.001, force)])


def _table(values: Sequence[float], step: float, force: float, ground: Ground) -> Situation | None:
    if ground.law != "radial":
        return None
    law = Radial(step, np.array(values, float))
    arm = ground.arm(law)
    return read(arm, [touch(arm, ONE, HALF, HALF, force)])


def _negative_tail(ground: Ground) -> Situation | None:
    """A silicone cover: below zero by 5 % of the peak from one pitch on."""
    if ground.law != "radial":
        return None
    d = 0.75e-3 * np.arange(64)
    k = 5e3 * (1.05 * np.exp(-((d / 5e-3) ** 2)) - 0.05 * np.exp(-((d / 20e-3) ** 2)))
    arm = ground.arm(Radial(0.75e-3, k))
    return read(arm, [touch(arm, ONE, 0.002, 0.001, 5.0)])


def _noise(sigma: float, force: float, ground: Ground) -> Situation:
    arm = ground.arm(noise=sigma)
    return read(arm, [touch(arm, ONE, 0.002, 0.001, force)], sigma, "noise")


def _more_than_tactels(ground: Ground) -> Situation:
    arm = ground.board(grid(2, 2, PITCH))
    spots = [(u, v) for u in (-0.006, 0.0, 0.006) for v in (-0.004, 0.004)]
    situation = read(arm, [touch(arm, 0, u, v, 5.0) for u, v in spots])
    return replace(situation, touches=None, felt=30.0)


def _strong_beside_weak(ground: Ground) -> Situation:
    """1000:1 in force, 14 mm apart: the skirt of the strong one covers the weak one."""
    arm = ground.arm()
    strong, weak = touch(arm, ONE, -HALF, -HALF, 50.0), touch(arm, ONE, 0.005, 0.005, 0.05)
    return read(arm, [strong, weak], NOISE, "strong", truth=[strong])


def _four_corners(ground: Ground) -> Situation:
    arm = ground.arm()
    s, a = place(arm, ONE, EDGE, EDGE)
    return read(arm, [(0, s, a, 40.0)])


_EXACT: Final = (PAPER, 1e-5, 1e-5)
_FORCE: Final = (1.5, 1e-3, 1e-3)

WHERE: Final = (
    Case(
        name="on a tactel",
        why="the distance is 0 and has no derivative; the cone has its tip there",
        holds="place and force to the end of the fit",
        must=Must(place=_EXACT, force=_FORCE),
        build=press((HALF, HALF, 5.0)),
    ),
    Case(
        name="between two",
        why="two tactels read the same: no maximum is the higher one",
        holds="one contact, place and force to the end of the fit",
        must=Must(place=_EXACT, force=_FORCE),
        build=press((0.0, HALF, 5.0)),
    ),
    Case(
        name="between four",
        why="four tactels read the same",
        holds="one contact, place and force to the end of the fit",
        must=Must(place=_EXACT, force=_FORCE),
        build=press((0.0, 0.0, 5.0)),
    ),
    Case(
        name="on a seam",
        why="two boards feel half each, 21 mm apart",
        holds="one contact, exact for the fits",
        must=Must(place=(FAR_OFF, 1e-4, 1e-4), force=(3.0, 1e-2, 1e-2)),
        build=press((0.002, EDGE, 40.0)),
    ),
    Case(
        name="on a corner of four boards",
        why="four clusters of one tactel each are one contact",
        holds="one contact, exact for the fits",
        must=Must(place=(2 * FAR_OFF, 1e-4, 1e-4), force=(3.0, 1e-2, 1e-2)),
        build=_four_corners,
    ),
    Case(
        name="on the wrap line",
        why="a jumps by a turn between the two boards that feel it",
        holds="one contact, exact for the fits",
        must=Must(place=(FAR_OFF, 1e-4, 1e-4), force=(3.0, 1e-2, 1e-2)),
        build=partial(_on_wrap, 0.0275),
    ),
    Case(
        name="on a corner on the wrap line",
        why="both at once",
        holds="one contact, exact for the fits",
        must=Must(place=(2 * FAR_OFF, 1e-3, 1e-3), force=(3.0, 0.05, 0.05)),
        build=partial(_on_wrap, 0.051),
    ),
    *(
        Case(
            name=f"two contacts {words} apart",
            why="the normal matrix of two is singular",
            holds="the sum of the forces; one contact, or two with large covariances",
            must=Must(count=(1, 2), place=(PAPER, 2e-3, 2e-3), force=(1.5, 0.6, 0.6)),
            build=partial(_twins, apart),
        )
        for words, apart in (("0", 0.0), ("1 nm", 1e-9), ("1 um", 1e-6), ("0.1 mm", 1e-4))
    ),
    Case(
        name="strong beside weak, 1000:1",
        why="the weak one is a twentieth of the noise on the skirt of the strong one",
        holds="the strong one as if it were alone, no false one; the weak one where its tactel shows it",
        must=Must(count=(1, 2), place=(6e-3, 5e-4, 5e-4), force=(1.5, 0.02, 0.02)),
        build=_strong_beside_weak,
    ),
    Case(
        name="more contacts than tactels",
        why="six touches, four readings: nothing separates them",
        holds="no more contacts than tactels; in sum the force by the law within a factor of 8",
        must=Must(count=(1, 4), force=7.0),
        build=_more_than_tactels,
    ),
    Case(
        name="just under the null zone",
        why="four tactels at 0.999 of their threshold",
        holds="kmeans sees nothing; the fits may, in its place",
        must=Must(count=(0, 1), kmeans_count=(0, 0), place=(1.0, 1e-3, 1e-3)),
        build=partial(_null_zone, 0.999),
    ),
    Case(
        name="just over the null zone",
        why="four tactels at 1.001 of their threshold",
        holds="one contact in its place",
        must=Must(place=1e-3, force=(1.5, 0.1, 0.1)),
        build=partial(_null_zone, 1.001),
    ),
    Case(
        name="contact wider than the arm",
        why="every tactel of every board reads nearly the same (the paper, VII-B)",
        holds="one contact; the fits find place and force in the differences",
        must=Must(place=(0.06, 1e-3, 1e-3), force=(1.0, 0.02, 0.02)),
        build=_wider_than_the_arm,
    ),
)

LAW: Final = (
    *(
        Case(
            name=f"drop-off of {slope:.0e} Pa/m",
            why=why,
            holds=holds,
            must=must,
            build=partial(_drop_off, slope),
        )
        for slope, why, holds, must in (
            (
                1e-3,
                "the field is flat to 1e-8 of itself; 8e18 N",
                "finite; the covariance of the place spans the board",
                Must(count=(1, 4)),
            ),
            (
                1.0,
                "flat to 1e-5, far below the noise; 8e12 N",
                "finite; the covariance of the place spans the board",
                Must(count=(1, 4)),
            ),
            (
                1e3,
                "0.1 % of the peak over a pitch; 8 MN",
                "the covariance covers what is undetermined",
                Must(count=(1, 4)),
            ),
            (1e6, "the usual", "exact for the fits", Must(place=_EXACT, force=_FORCE)),
            (
                1e9,
                "20 um wide: one tactel sees it",
                "at that tactel, few tactels",
                Must(place=PITCH, says=ANY),
            ),
            (1e12, "20 nm wide", "at that tactel, few tactels", Must(place=PITCH, says=ANY)),
        )
    ),
    Case(
        name="table with a tail of -5 %",
        why="its inverse has no meaning where it is negative, and its own tail looks like a pull",
        holds="one contact, exact for the fits",
        must=Must(place=_EXACT, force=_FORCE),
        build=_negative_tail,
    ),
    Case(
        name="table of one point",
        why="the law has no width: no derivative, reach 0",
        holds="at the tactel, few tactels",
        must=Must(place=PITCH, says=ANY),
        build=partial(_table, [4e3], 1e-3, 5.0),
    ),
    Case(
        name="table of two points",
        why="one cubic, its reach less than a pitch",
        holds="at the tactel, few tactels",
        must=Must(place=PITCH, says=ANY),
        build=partial(_table, [4e3, 0.0], 8e-3, 5.0),
    ),
    Case(
        name="no noise declared",
        why="weights are those of the rounding of the counts alone",
        holds="exact for the fits",
        must=Must(place=_EXACT, force=_FORCE),
        build=partial(_noise, 0.0, 5.0),
    ),
    Case(
        name="noise above the signal",
        why="a contact of 2 N under noise of 20 kPa, known to be so",
        holds="no contact with a small covariance where nothing is",
        must=Must(count=(0, 3), kmeans_count=(0, 40)),
        build=partial(_noise, 20e3, 2.0),
    ),
)
