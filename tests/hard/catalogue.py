"""The table of hard cases: what touches or is read, and what a level must make of it.

A row is a name and (what must hold, builder, its arguments); a builder returns None where a surface or a law
has no such case. Most cases press on the second board, which has neighbours on both sides.
"""

import math
from dataclasses import replace

import numpy as np

from skinbus.estimate import Quality
from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Radial, Surface, Transducer, grid
from tests.hard.check import Must, Situation
from tests.hard.ground import FULL_SCALE, NOISE, PITCH, THRESHOLD, law_of, pressures_under, surface_of, touch

HALF = 0.5 * PITCH
EDGE = 0.0255
"""From the centre of a board to the middle of the seam around it, m."""
PAPER = 4e-3
"""m: the most that K-means is off inside a board."""
FAR_OFF = 12e-3
"""m: the outer tactels of two boards are 21 mm apart, and K-means answers with one of them."""
SPOT = (0.002, 0.001, 5.0)
"""Where most cases press: u and v (m) on the second board, and the force (N)."""
UV = grid(4, 4, PITCH)
ALIVE = np.ones(16, np.bool_)
TAIL = 5e3 * np.array([1.05, -0.05]) @ np.exp(-((0.75e-3 * np.arange(64) / np.c_[[5e-3, 20e-3]]) ** 2))
"""The table of a silicone cover: below zero by 5 % of the peak from one pitch on."""
CHEQUERS = np.pad(np.tile([[2e4, 0.0, 2e4, 0.0], [0.0, 2e4, 0.0, 2e4]], (2, 1)).ravel(), (16, 0))
"""Every other tactel of the second board, Pa."""


# --- Builders ---------------------------------------------------------------------------------------


def read(arm, touches, noise=0.0):
    """What an arm reads of touches."""
    pressures = pressures_under(arm, touches) + noise * np.random.default_rng(1).standard_normal(
        arm.n_tactels
    )
    return Situation(arm, np.minimum(pressures, arm.patches[0].patch.transducer.full_scale), touches)


def press(ground, u, v, force, **settings):
    """One touch on the second board; ``settings`` go to every patch."""
    arm = ground.arm(**settings)
    return read(arm, [touch(arm, 1, u, v, force)], settings.get("noise", 0.0))


def noisy(ground, sigma, force):
    """One touch under noise that the board declares."""
    return press(ground, *SPOT[:2], force, noise=sigma)


def press_law(ground, law, u, v, force):
    """One touch under a law of its own, once for each surface."""
    return press(ground, u, v, force, law=law) if ground.law == "cone" else None


def press_board(ground, uv, u, v, force):
    """One touch on a board alone with tactels of its own."""
    arm = ground.board(uv)
    return read(arm, [touch(arm, 0, u, v, force)])


def press_patches(ground, change):
    """The usual touch; ``change`` makes the patches of the usual ones."""
    usual = ground.arm()
    arm = Arm("changed", usual.links, change(usual.patches))
    return read(arm, [touch(arm, 1, *SPOT)])


def press_small(ground, kind, surface, placed, pitch, force):
    """One touch on a small arm of one board, where the surface is of a kind."""
    if ground.surface != kind:
        return None
    patch = Patch(tactels_uv=grid(4, 4, pitch), size=(5 * pitch, 5 * pitch), law=law_of(ground.law))
    arm = Arm(kind, [Link(kind, surface)], [PlacedPatch(patch=patch, node_id=1, link=0, s=placed, a=0.0)])
    return read(arm, [touch(arm, 0, 0.2 * pitch, 0.1 * pitch, force)])


def on_wrap(ground, s):
    """A touch where a jumps by a turn."""
    period = surface_of(ground.surface).period
    return read(ground.arm(), [(0, s, 0.5 * period, 60.0)]) if period else None


def two_laws(ground):
    """A touch on the seam between a board under a cone and one under a radial law."""
    usual, laws = ground.arm(), [law_of("cone"), law_of("radial")]
    patches = [replace(p, patch=replace(p.patch, law=laws[n % 2])) for n, p in enumerate(usual.patches)]
    arm = Arm("two laws", usual.links, patches)
    return read(arm, [touch(arm, 1, 0.002, 0.0225, 15.0)])


def hole(ground, gap):
    """Three boards around a hole in a plate: the centroid of their clusters is in it."""
    if ground != ("plane", "cone"):
        return None
    patch, step = Patch(tactels_uv=UV, law=Cone(2e5)), 0.050 + gap
    places = [(0.1, 0.0), (0.1 + step, 0.0), (0.1, step)]
    placed = [PlacedPatch(patch=patch, node_id=n + 1, link=0, s=s, a=a) for n, (s, a) in enumerate(places)]
    arm = Arm("hole", [Link("plate", Surface.plane(0.4, 0.4))], placed)
    middle = 0.5 * step + 6e-3
    return read(arm, [(0, 0.1 + middle, middle, 300.0)])._replace(touches=None)


def twins(ground, apart):
    """Two touches of 5 N so near that they count as one of 10 N."""
    arm = ground.arm()
    one, other = (touch(arm, 1, 0.002 + u, 0.001, 5.0) for u in (0.0, apart))
    return read(arm, [one, other])._replace(touches=[(*one[:3], 10.0)])


def strong_and_weak(ground):
    """1000:1 in force, 14 mm apart."""
    arm = ground.arm()
    strong, weak = touch(arm, 1, -HALF, -HALF, 50.0), touch(arm, 1, HALF, HALF, 0.05)
    return read(arm, [strong, weak], NOISE)._replace(touches=[strong])


def null_zone(ground, share):
    """Between four tactels, with a force that brings them to ``share`` of their threshold."""
    return press(ground, 0.0, 0.0, float(law_of(ground.law).force(share * THRESHOLD, math.hypot(HALF, HALF))))


def wide(ground):
    """The base of the contact is a metre, as in the paper's section VII-B."""
    law = Cone(1e5) if ground.law == "cone" else Radial(20e-3, np.linspace(1.0, 0.0, 51))
    return press(ground, *SPOT[:2], float(law.force(100e3, 0.0)), law=law)


def crowd(ground):
    """Six touches on four tactels."""
    arm = ground.board(grid(2, 2, PITCH))
    spots = [(u, v) for u in (-0.006, 0.0, 0.006) for v in (-0.004, 0.004)]
    return read(arm, [touch(arm, 0, *spot, 5.0) for spot in spots])._replace(touches=None, felt=30.0)


def saturated(ground, share):
    """A touch whose peak is this many times full scale."""
    force = float(law_of(ground.law).force(share * 20e3, 0.0))
    return press(ground, *SPOT[:2], force, transducer=Transducer(full_scale=20e3))


def reads(ground, value, touches=None, n=2):
    """Every tactel of n boards reads this."""
    arm = ground.mount(ground.arm().patches[0].patch for _ in range(n))
    return Situation(arm, np.resize(np.asarray(value, float), arm.n_tactels), touches)


def board_reads(ground, value):
    """One board alone, every tactel the same: a palm, or water."""
    arm = ground.board(UV)
    return Situation(arm, np.full(16, value), None, felt=0.050**2 * value)


def some(ground, readings, is_one=False):
    """Tactels of the second board read what no touch makes; they, or their middle, count as touched."""
    arm = ground.arm()
    pressures, at = np.zeros(arm.n_tactels), 16 + np.array(list(readings))
    pressures[at] = list(readings.values())
    places = np.stack([arm.tactel_s[at], arm.tactel_a[at]], -1)
    places = places.mean(axis=0, keepdims=True) if is_one else places
    return Situation(arm, pressures, [(0, *place, math.nan) for place in places.tolist()])


def broken(ground, readings):
    """The usual touch, and tactels that read this: one at full scale makes a contact where it stands."""
    situation = press(ground, *SPOT)
    arm, touches = situation.arm, list(situation.touches)
    for i, value in readings.items():
        situation.pressures[i] = value
        if value >= FULL_SCALE:
            touches.append((0, float(arm.tactel_s[i]), float(arm.tactel_a[i]), 0.0))
    return situation._replace(touches=touches)


def dead(ground, which):
    """The usual touch, and dead tactels at full scale on every board."""
    healthy = ALIVE.copy()
    healthy[which] = False
    situation = press(ground, *SPOT, healthy=healthy)
    situation.pressures[~situation.arm.tactel_healthy] = FULL_SCALE
    return situation if healthy.any() else situation._replace(touches=[])


def silent(ground):
    """The board under the touch sends nothing."""
    situation = press(ground, *SPOT)
    return situation._replace(valid=np.arange(situation.arm.n_patches) != 1)


def negative(ground):
    """A zero taken too high."""
    situation = press(ground, *SPOT)
    situation.pressures[situation.pressures == 0.0] = -100.0
    situation.pressures[64:] = -5e4
    return situation


# --- The table --------------------------------------------------------------------------------------

ANY = Quality(63)
EXACT = Must(place=(PAPER, 1e-5, 1e-5), force=(1.5, 1e-3, 1e-3))
SEAM = Must(place=(FAR_OFF, 1e-4, 1e-4), force=(3.0, 1e-2, 1e-2))
CORNER = SEAM._replace(place=(2 * FAR_OFF, 1e-4, 1e-4))
SURE = Must(place=(PITCH, 1e-5, 1e-5), force=(3.0, 1e-3, 1e-3))
NONE = Must(count=(0, 0))
NEAR = Must(place=PITCH)
TWINS = Must(count=(1, 2), place=(PAPER, 2e-3, 2e-3), force=(1.5, 0.6, 0.6))
PALM = Must(count=(1, 16), force=(32.0, 3.0, 3.0))
AT_TACTEL = NEAR._replace(says=ANY)
FEW = NEAR._replace(says=Quality.FEW_TACTELS)
FINITE = Must(count=(1, 40))
UNSURE = FINITE._replace(says=ANY)
SMALLEST = 5e-324
NO_NUMBERS = (math.nan, math.inf, -math.inf)

WHERE = {
    "on a tactel": (EXACT, press, HALF, HALF, 5.0),  # distance 0; the cone has its tip there
    "between two": (EXACT, press, 0.0, HALF, 5.0),  # no maximum is the higher one
    "between four": (EXACT, press, 0.0, 0.0, 5.0),
    "on a seam": (SEAM, press, 0.002, EDGE, 40.0),  # two boards feel half each, 21 mm apart
    "on a corner of four boards": (CORNER, press, EDGE, EDGE, 40.0),  # four clusters of one tactel
    "on the wrap line": (SEAM, on_wrap, 0.0275),
    "on a corner on the wrap line": (
        Must(place=(2 * FAR_OFF, 1e-3, 1e-3), force=(3.0, 0.05, 0.05)), on_wrap, 0.051,
    ),
    # the normal matrix of two is singular
    "two contacts 0 apart": (TWINS, twins, 0.0),
    "two contacts 1 nm apart": (TWINS, twins, 1e-9),
    "two contacts 1 um apart": (TWINS, twins, 1e-6),
    "two contacts 0.1 mm apart": (TWINS, twins, 1e-4),
    # the weak one is a twentieth of the noise on the skirt of the strong one
    "strong beside weak, 1000:1": (
        Must(count=(1, 2), place=(6e-3, 5e-4, 5e-4), force=(1.5, 0.02, 0.02)), strong_and_weak,
    ),
    "more contacts than tactels": (Must(count=(1, 4), force=7.0), crowd),
    "just under the null zone": (
        Must(count=(0, 1), kmeans_count=(0, 0), place=(1.0, 1e-3, 1e-3)), null_zone, 0.999,
    ),
    "just over the null zone": (Must(place=1e-3, force=(1.5, 0.1, 0.1)), null_zone, 1.001),
    # every tactel of every board reads nearly the same
    "contact wider than the arm": (Must(place=(0.06, 1e-3, 1e-3), force=(1.0, 0.02, 0.02)), wide),
}  # fmt: skip
LAW = {
    # a cone of any slope right on a tactel, with a peak of 20 kPa: flat to 1e-8 of itself, or 20 nm wide
    **{
        f"drop-off of {slope:.0e} Pa/m": (
            must, press_law, Cone(slope), HALF, HALF, math.pi * 20e3**3 / (3.0 * slope**2),
        )
        for slope, must in (
            (1e-3, Must(count=(1, 4))), (1.0, Must(count=(1, 4))), (1e3, Must(count=(1, 4))),
            (1e6, EXACT), (1e9, AT_TACTEL), (1e12, AT_TACTEL),
        )
    },
    # its own tail looks like a pull
    "table with a tail of -5 %": (EXACT, press_law, Radial(0.75e-3, TAIL), *SPOT),
    "table of one point": (AT_TACTEL, press_law, Radial(1e-3, np.array([4e3])), HALF, HALF, 5.0),
    "table of two points": (AT_TACTEL, press_law, Radial(8e-3, np.array([4e3, 0.0])), HALF, HALF, 5.0),
    "no noise declared": (EXACT, noisy, 0.0, 5.0),
    "noise above the signal": (Must(count=(0, 3), kmeans_count=(0, 40)), noisy, 20e3, 2.0),
}  # fmt: skip
READINGS = {
    "no active tactel": (NONE, reads, 0.0, []),
    "noise alone": (NONE, reads, NOISE * np.random.default_rng(3).standard_normal(32), []),
    # three unknowns, one reading or two
    "one active tactel": (NEAR, some, {5: 5e3}),
    "two active tactels": (Must(count=(1, 2), place=PITCH), some, {5: 5e3, 6: 5e3}, True),
    # across the row the place is that of its mirror image
    "three in a row": (Must(count=(1, 3), place=1.5 * PITCH), some, {4: 5e3, 5: 9e3, 6: 5e3}),
    # no place explains it: the force is right within a factor of 4
    **{f"flat field of {kpa} kPa": (PALM, board_reads, 1e3 * kpa) for kpa in (2, 5, 20, 50)},
    "flat field over the whole arm": (FINITE, reads, 20e3, None, 6),
    # the readings that hold most are only lower bounds
    "saturated in the middle": (
        Must(place=(PAPER, 1e-3, 1e-3), force=(1.5, 0.05, 0.05), says=Quality.SATURATED), saturated, 2.5,
    ),
    "saturated four times over": (
        Must(place=(2 * PITCH, PITCH, PITCH), says=Quality.SATURATED), saturated, 4.0,
    ),
    "all at full scale": (UNSURE, reads, FULL_SCALE),
    "one stuck at full scale": (
        Must(count=(1, 2), place=(PITCH, 2e-3, 2e-3)), broken, {48: FULL_SCALE},
    ),
    "one stuck at full scale under the contact": (
        Must(count=(1, 3), place=(1.5 * PITCH, 2.5 * PITCH, 3.1 * PITCH)), broken, {16: FULL_SCALE},
    ),
    "a dead row": (SURE, dead, slice(4, 8)),
    # a tactel at most feels it, 14 mm off
    "only two rows alive, apart": (Must(count=(0, 2), place=2 * PITCH), dead, slice(4, 12)),
    "all dead": (NONE, dead, slice(16)),
    "the board sends nothing": (Must(count=(0, 1)), silent),
    "negative after the baseline": (Must(place=(PAPER, 1e-4, 1e-4), force=(1.5, 0.02, 0.02)), negative),
    "all negative": (NONE, reads, -5e4),
    **{f"all read {v:g}": (NONE, reads, v) for v in (*NO_NUMBERS, SMALLEST, 1e-300, -1e300)},
    "all read 1e+300": (UNSURE, reads, 1e300),
    **{f"one reads {v:g}": (EXACT, broken, {16: v, 31: v}) for v in (*NO_NUMBERS, 0.0, SMALLEST, 1e-300)},
    "a reading of NaN under the contact": (SURE, broken, {26: math.nan}),
    # the most extreme pattern of 16-bit counts
    "ends of the counts by turns": (Must(count=(0, 40)), reads, (FULL_SCALE, -FULL_SCALE * 32768 / 32767)),
    "chequerboard": (Must(count=(1, 12)), reads, CHEQUERS),
}  # fmt: skip
BOARDS = {
    # one reading or two, three unknowns; the mirror image fits as well
    "board of one tactel": (FEW, press_board, np.zeros((1, 2)), *SPOT),
    "board of two tactels": (FEW, press_board, np.array([[-HALF, 0.0], [HALF, 0.0]]), 0.001, 0.001, 5.0),
    "board of one row": (NEAR, press_board, grid(6, 1, 8e-3), 0.001, 0.003, 5.0),
    "two tactels at one place": (EXACT, press_board, np.r_[UV, [[HALF, HALF]]], *SPOT),
    "64 tactels 1 mm apart": (EXACT, press_board, grid(8, 8, 1e-3), 0.0004, 0.0002, 5.0),
    # cosine of yaw is 6e-17, not 0; tactels of neighbours overlap
    **{
        f"board turned by {deg} degrees": (
            EXACT, press_patches, lambda ps, deg=deg: [replace(p, yaw=math.radians(deg)) for p in ps],
        )
        for deg in (90, 45)
    },
    "board mirrored": (EXACT, lambda ground: press(ground, *SPOT, tactels_uv=UV * [-1.0, 1.0])),
    # a tenth of a pitch apart: two patches respond to all of it
    "two boards on one place": (
        EXACT, press_patches, lambda ps: [*ps, replace(ps[1], node_id=99, s=ps[1].s + 1e-3)],
    ),
    # 8 mm thick, the tip 31 mm further on: a turn is 25 mm, a stretches by 5 against the surface
    "frustum near its tip": (
        Must(place=(PAPER, 1e-4, 1e-4), force=(3.0, 0.05, 0.05)),
        press_small, "frustum", Surface.cone(0.20, 0.030, 0.001), 0.18, 3e-3, 0.5,
    ),
    # the plane as a limit: a / radius is 1e-9
    "cylinder of 1000 km radius": (
        EXACT, press_small, "cylinder", Surface.cylinder(0.1, 1e6), 0.05, PITCH, 5.0,
    ),
    # one force, two shapes, on the seam between them
    **{f"hole of {1e3 * gap:g} mm between three boards": (FINITE, hole, gap) for gap in (0.0, 5e-3, 12e-3)},
    "two laws under one contact": (
        Must(place=(2 * PITCH, 1e-4, 1e-4), force=(3.0, 0.01, 0.01)), two_laws,
    ),
}  # fmt: skip
CASES = {**WHERE, **LAW, **READINGS, **BOARDS}
