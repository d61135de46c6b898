"""Contacts do not depend on how the skin is described: order, place, unit, mirror, cut, division into boards.

Tolerances. Where only the order of sums changes, places agree to PLACE (m of a board with a pitch of 10 mm):
a fit ends when a step is worth 3e-4 of a standard deviation, here 1e-7 m. Where nothing but the exponent
of numbers changes (powers of four), or nothing but the numbering of patches, every bit agrees.
"""

from dataclasses import replace

import numpy as np
import pytest

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Radial, Surface, Transducer, grid
from tests.hard.ground import LAWS, PITCH, SURFACES, Ground, law_of, pressures_under, touch
from tests.marks import levels

PLACE = 3e-7
FORCE = 3e-5
SIGMA = 1e-3
"""Relative, of reported standard deviations: their change over PLACE."""
SEEDS = range(10)
UV = grid(4, 4, PITCH)
laws = pytest.mark.parametrize("law", LAWS)


def readings_of(arm, seed):
    """Pressures with noise of one or two touches well inside boards of an arm, one to a board."""
    rng = np.random.default_rng(seed)
    chosen = rng.choice(arm.n_patches, size=min(2, arm.n_patches), replace=False)
    spots = zip(chosen, *rng.uniform(-0.014, 0.014, (2, 2)), rng.uniform(3, 12, 2), strict=False)
    touches = [(0, arm.patches[p].s + u, arm.patches[p].a + v, force) for p, u, v, force in spots]
    noise = 200.0 * np.random.default_rng(seed + 1).standard_normal(arm.n_tactels)
    return pressures_under(arm, touches) + noise


def answer(estimator, pressures):
    """Rows of (s, a, force, sigmas), in an order that does not depend on that of the contacts."""
    contacts = estimator.update(pressures, 0)
    sigma = np.sqrt(np.diagonal(contacts.covariance, axis1=1, axis2=2))
    rows = np.column_stack([contacts.s, contacts.a, contacts.force, sigma])
    return rows[np.argsort(contacts.force)]


def assert_same(one, two, *, scale=1.0, force=1.0, period=np.inf, factor=1.0):
    """Two answers agree, the second in lengths ``scale`` and forces ``force`` times the first's."""
    assert one.shape == two.shape
    place = two[:, :2] / scale - one[:, :2]
    place[:, 1] -= period * np.round(place[:, 1] / period) if np.isfinite(period) else 0.0
    assert np.abs(place).max(initial=0.0) <= factor * PLACE
    assert np.allclose(two[:, 2] / force, one[:, 2], rtol=factor * FORCE, atol=0.0)
    assert np.allclose(two[:, 3:] / [scale, scale, force], one[:, 3:], rtol=factor * SIGMA, atol=0.0)


def renumber(arm, pressures, rng):
    """The same arm with patches and their tactels in another order, and what it reads."""
    tactels, order = rng.permutation(16), rng.permutation(arm.n_patches)
    patches = [arm.patches[p] for p in order]
    patches = [replace(p, patch=replace(p.patch, tactels_uv=UV[tactels])) for p in patches]
    return Arm("renumbered", arm.links, patches), pressures.reshape(-1, 16)[order][:, tactels].ravel()


@levels
@laws
def test_order_of_tactels_and_patches_does_not_matter(level, law):
    arm = Ground("cylinder", law).arm()
    estimator = Estimator(arm, level)
    for seed in SEEDS:
        pressures = readings_of(arm, seed)
        other, read = renumber(arm, pressures, np.random.default_rng(seed))
        assert_same(answer(estimator, pressures), answer(Estimator(other, level), read))


@laws
def test_order_does_not_matter_to_touches_that_meet_at_corners_and_seams(law):
    # a tactel at a corner is the border to two patches at once. Fits start from here; where several contacts
    # overlap, they may still end in different modes
    rng, arm = np.random.default_rng(5), Ground("plane", law).arm()
    other, tactels = renumber(arm, np.arange(arm.n_tactels), rng)
    one, two = Estimator(arm), Estimator(other)
    for n in range(60):
        spots = [
            touch(arm, int(p), *rng.uniform(-0.026, 0.026, 2), 10.0 ** rng.uniform(0.3, 1.7))
            for p in rng.integers(arm.n_patches, size=1 + n % 4)
        ]
        pressures = pressures_under(arm, spots) + 200.0 * rng.standard_normal(arm.n_tactels)
        a, b = answer(one, pressures), answer(two, pressures[tactels])
        assert len(a) == len(b), n
        assert np.abs(np.sort(a[:, 0]) - np.sort(b[:, 0])).max(initial=0.0) <= 10.0 * PLACE, n


@levels
@laws
def test_rotation_translation_and_mirror_move_the_contacts_along(level, law):
    # one board on a plate; its readings stay, its place changes
    patch, link = Patch(tactels_uv=UV, law=law_of(law)), Link("plate", Surface.plane(1.0, 1.0))
    here = PlacedPatch(patch=patch, node_id=1, link=0, s=0.0, a=0.0)
    arm = Arm("plate", [link], [here])
    estimator = Estimator(arm, level)
    for seed in SEEDS:
        pressures, rng = readings_of(arm, seed), np.random.default_rng(seed)
        yaw, s, a, mirror = rng.uniform(-np.pi, np.pi), *rng.uniform(-0.1, 0.4, 2), (1.0, -1.0)[seed % 2]
        mirrored = replace(patch, tactels_uv=UV * [1.0, mirror])
        there = replace(here, patch=mirrored, s=s, a=a, yaw=yaw)
        one = estimator.update(pressures, 0)
        two = Estimator(Arm("plate", [link], [there]), level).update(pressures, 0)
        order, other = np.argsort(one.force), np.argsort(two.force)
        moved = np.exp(1j * yaw) * (one.s + 1j * mirror * one.a) + s + 1j * a
        assert len(one) == len(two)
        # digits of a place 0.4 m off are those of 0.4 m
        assert np.allclose(moved[order], (two.s + 1j * two.a)[other], rtol=0.0, atol=PLACE)
        assert np.allclose(one.force[order], two.force[other], rtol=FORCE)
        areas = [np.linalg.det(c.covariance[i, :2, :2]) for c, i in ((one, order), (two, other))]
        assert np.allclose(*areas, rtol=SIGMA)


@levels
@laws
def test_shift_round_the_cylinder_shifts_the_contacts(level, law):
    arm = Ground("cylinder", law).arm()
    surface, estimator = arm.links[0].surface, Estimator(arm, level)
    for seed, turn in zip(SEEDS, np.linspace(0.0, 1.0, len(SEEDS)), strict=True):
        pressures, shift = readings_of(arm, seed), turn * surface.period
        moved = [replace(p, a=float(surface.wrap(p.a + shift))) for p in arm.patches]
        one = answer(estimator, pressures)
        one[:, 1] += shift
        two = answer(Estimator(Arm("turned", arm.links, moved), level), pressures)
        assert_same(one, two, period=surface.period)


def scaled(arm, length, pressure):
    """The same arm with all lengths and all pressures times a factor, and the laws to match."""
    patches = []
    for placed in arm.patches:
        patch = placed.patch
        if isinstance(patch.law, Cone):
            law = replace(patch.law, slope=patch.law.slope * pressure / length)
        else:  # forces are pressures times areas
            law = Radial(patch.law.step * length, patch.law.table / length**2, misfit=patch.law.misfit)
        patch = replace(
            patch,
            law=law,
            tactels_uv=patch.tactels_uv * length,
            size=tuple(length * extent for extent in patch.size),
            transducer=Transducer(full_scale=patch.transducer.full_scale * pressure),
            **{name: getattr(patch, name) * pressure for name in ("threshold", "release", "noise")},
        )
        patches.append(replace(placed, patch=patch, s=placed.s * length, a=placed.a * length))
    surface = arm.links[0].surface
    lengths = {name: getattr(surface, name) * length for name in ("length", "period", "width")}
    radius = surface.radius * (length if surface.period else 1.0)
    return Arm("scaled", [Link("scaled", replace(surface, radius=radius, **lengths))], patches)


@levels
@laws
@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize(("length", "pressure"), [(4.0**-10, 4.0**10), (4.0**10, 4.0**-10), (4.0, 1.0)])
def test_powers_of_four_of_the_units_change_no_bit_of_the_places(level, law, surface, length, pressure):
    arm = Ground(surface, law).arm()
    pressures = readings_of(arm, 5)
    one = answer(Estimator(arm, level), pressures)
    two = answer(Estimator(scaled(arm, length, pressure), level), pressures * pressure)
    assert len(one) == 2
    if law == "cone" and level == "kmeans":  # its place does not go through the logarithm of the force
        assert np.array_equal(one[:, :2] * length, two[:, :2])
    assert_same(one, two, scale=length, force=pressure * length**2, factor=1e-3)


@levels
@laws
def test_a_board_split_in_two_feels_the_same(level, law):
    # the fits use tactels, not boards; K-means clusters each board, so it may differ: its sum may not
    whole = Ground("plane", law).board(UV)
    board, halves, order = whole.patches[0], [], np.argsort(UV[:, 0] > 0.0, kind="stable")
    for n, (side, shift) in enumerate(zip(np.split(UV[order], 2), (-0.0125, 0.0125), strict=True)):
        half = replace(board.patch, tactels_uv=side - [shift, 0.0], size=(0.025, 0.050))
        halves.append(replace(board, node_id=n + 1, s=board.s + shift, patch=half))
    one, two = Estimator(whole, level), Estimator(Arm("halves", whole.links, halves), level)
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        pressures = pressures_under(whole, [touch(whole, 0, *rng.uniform(-0.012, 0.012, 2), 8.0)])
        pressures += 200.0 * rng.standard_normal(16)
        a = answer(one, pressures)
        assert len(a) == 1
        assert_same(a, answer(two, pressures[order]), factor=1e-5 if level == "kmeans" else 1.0)
