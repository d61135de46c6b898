"""Contacts do not depend on how the skin is described: order, place, unit, mirror, cut, division into boards.

Tolerances. Where only the order of sums changes, places agree to PLACE (m of a board with a pitch of 10 mm):
a fit ends when a step is worth 3e-4 of a standard deviation, here 1e-7 m. Where nothing but the exponent
of numbers changes (powers of four), or nothing but the numbering of patches, every bit agrees.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from skinbus.estimate import LEVELS, Estimator
from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Radial, Surface, Transducer, grid
from tests.hard.ground import Ground, law_of, pressures_under, touch

PLACE = 3e-7
FORCE = 3e-5
SIGMA = 1e-3
"""Relative, of reported standard deviations: their change over PLACE."""
UNIT_SIGMA = 30.0
"""Times SIGMA, where lengths are scaled by no power of 4: of the steps in which flat modes are measured."""
SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=12, derandomize=True)  # the same examples on every run
levels = pytest.mark.parametrize("level", LEVELS)
laws = pytest.mark.parametrize("law", ["cone", "radial"])


def touches_on(arm, seed, n=2):
    """Touches well inside boards of an arm, one to a board."""
    rng = np.random.default_rng(seed)
    chosen = rng.choice(arm.n_patches, size=min(n, arm.n_patches), replace=False)
    return [
        (arm.patches[p].link, arm.patches[p].s + u, arm.patches[p].a + v, f)
        for p, u, v, f in zip(
            chosen,
            rng.uniform(-0.014, 0.014, n),
            rng.uniform(-0.014, 0.014, n),
            rng.uniform(3, 12, n),
            strict=False,
        )
    ]


def readings_of(arm, seed, noise=200.0):
    """Pressures of touches with noise."""
    rng = np.random.default_rng(seed + 1)
    return pressures_under(arm, touches_on(arm, seed)) + noise * rng.standard_normal(arm.n_tactels)


def columns(contacts):
    """Rows of (link, s, a, force, sigmas), in an order that does not depend on that of the contacts."""
    sigma = np.sqrt(np.array([np.diag(R) for R in contacts.covariance]).reshape(-1, 3))
    rows = np.column_stack([contacts.link, contacts.s, contacts.a, contacts.force, sigma])
    return rows[np.lexsort((rows[:, 3],))]


def assert_same(one, two, *, scale=1.0, force=1.0, period=0.0, factor=1.0, sigma=1.0):
    """Two tables of columns agree, the second in lengths ``scale`` and forces ``force`` times the first's."""
    assert one.shape == two.shape
    place = np.abs(two[:, 1:3] / scale - one[:, 1:3])
    if period:
        place[:, 1] = np.abs(place[:, 1] - period * np.round(place[:, 1] / period))
    assert place.max(initial=0.0) <= factor * PLACE
    assert np.allclose(two[:, 3] / force, one[:, 3], rtol=factor * FORCE, atol=0.0)
    sigmas = two[:, 4:] / [scale, scale, force]
    assert np.allclose(sigmas, one[:, 4:], rtol=factor * sigma * SIGMA, atol=0.0)


@levels
@laws
@FEW
@given(seed=SEEDS)
def test_order_of_tactels_does_not_matter(level, law, seed):
    order = np.random.default_rng(seed).permutation(16)
    uv = grid(4, 4, 0.010)
    one, two = (Ground("plane", law).board(positions) for positions in (uv, uv[order]))
    pressures = readings_of(one, seed)
    a = Estimator(one, level).update(pressures, 0)
    b = Estimator(two, level).update(pressures[order], 0)
    assert_same(columns(a), columns(b))


@levels
@laws
@FEW
@given(seed=SEEDS)
def test_order_of_patches_does_not_matter(level, law, seed):
    arm = Ground("cylinder", law).arm()
    order = np.random.default_rng(seed).permutation(arm.n_patches)
    other = Arm("other", arm.links, [arm.patches[p] for p in order])
    pressures = readings_of(arm, seed)
    tactels = np.concatenate([np.arange(arm.n_tactels)[arm.tactels_of(p)] for p in order])
    a = Estimator(arm, level).update(pressures, 0)
    b = Estimator(other, level).update(pressures[tactels], 0)
    assert_same(columns(a), columns(b))


@laws
def test_the_order_of_patches_does_not_matter_to_touches_that_meet_at_corners_and_seams(law):
    # a tactel at a corner is the border to two patches at once. Fits start from here; where several contacts
    # overlap, they may still end in different modes
    rng = np.random.default_rng(5)
    print("seed 5")
    arm = Ground("plane", law).arm()
    order = rng.permutation(arm.n_patches)
    other = Arm("other", arm.links, [arm.patches[p] for p in order])
    tactels = np.concatenate([np.arange(arm.n_tactels)[arm.tactels_of(p)] for p in order])
    one, two = Estimator(arm), Estimator(other)
    for n in range(60):
        spots = [
            touch(arm, int(p), *rng.uniform(-0.026, 0.026, 2), 10.0 ** rng.uniform(0.3, 1.7))
            for p in rng.integers(arm.n_patches, size=1 + n % 4)
        ]
        pressures = pressures_under(arm, spots) + 200.0 * rng.standard_normal(arm.n_tactels)
        a, b = one.update(pressures, n), two.update(pressures[tactels], n)
        assert len(a) == len(b), n
        assert np.abs(a.s[np.argsort(a.s)] - b.s[np.argsort(b.s)]).max(initial=0.0) <= 10.0 * PLACE, n


@levels
@laws
@FEW
@given(seed=SEEDS, yaw=st.floats(-np.pi, np.pi), mirror=st.booleans(), shift=st.floats(-0.1, 0.1))
def test_rotation_translation_and_mirror_move_the_contacts_along(level, law, seed, yaw, mirror, shift):
    # one board on a plate; its readings stay, its place changes
    patch = Patch(tactels_uv=grid(4, 4, 0.010), law=law_of(law))
    mirrored = replace(patch, tactels_uv=patch.tactels_uv * [1.0, -1.0]) if mirror else patch
    link = Link("plate", Surface.plane(1.0, 1.0))
    here = Arm("here", [link], [PlacedPatch(patch=patch, node_id=1, link=0, s=0.0, a=0.0)])
    there = Arm(
        "there",
        [link],
        [PlacedPatch(patch=mirrored, node_id=1, link=0, s=0.3 + shift, a=shift, yaw=yaw)],
    )
    pressures = readings_of(here, seed)
    a, b = Estimator(here, level).update(pressures, 0), Estimator(there, level).update(pressures, 0)
    u, v = a.s, -a.a if mirror else a.a
    s = 0.3 + shift + np.cos(yaw) * u - np.sin(yaw) * v
    t = shift + np.sin(yaw) * u + np.cos(yaw) * v
    order, other = np.argsort(a.force), np.argsort(b.force)
    assert len(a) == len(b)
    # digits of a place 0.4 m off are those of 0.4 m
    assert np.allclose(s[order], b.s[other], rtol=0.0, atol=PLACE)
    assert np.allclose(t[order], b.a[other], rtol=0.0, atol=PLACE)
    assert np.allclose(a.force[order], b.force[other], rtol=FORCE)
    area = [np.linalg.det(c.covariance[i][:, :2, :2]) for c, i in ((a, order), (b, other))]
    assert np.allclose(area[0], area[1], rtol=SIGMA)


@levels
@laws
@FEW
@given(seed=SEEDS, turn=st.floats(0.0, 1.0))
@example(seed=1, turn=0.5)
def test_shift_round_the_cylinder_shifts_the_contacts(level, law, seed, turn):
    arm = Ground("cylinder", law).arm()
    surface = arm.links[0].surface
    shift = turn * surface.period
    moved = [replace(p, a=float(surface.wrap(p.a + shift))) for p in arm.patches]
    other = Arm("turned", arm.links, moved)
    pressures = readings_of(arm, seed)
    a = columns(Estimator(arm, level).update(pressures, 0))
    b = columns(Estimator(other, level).update(pressures, 0))
    a[:, 2] += shift
    assert_same(a, b, period=surface.period)


def scaled(arm, length, pressure):
    """The same arm with all lengths and all pressures times a factor, and the laws to match."""
    patches = []
    for placed in arm.patches:
        law = placed.patch.law
        if isinstance(law, Cone):
            law = replace(law, slope=law.slope * pressure / length)
        else:  # forces are pressures times areas
            law = Radial(law.step * length, np.asarray(law.table) / length**2, law.exponent, law.misfit)
        patch = replace(
            placed.patch,
            tactels_uv=placed.patch.tactels_uv * length,
            size=tuple(length * extent for extent in placed.patch.size),
            law=law,
            transducer=Transducer(full_scale=placed.patch.transducer.full_scale * pressure),
            threshold=placed.patch.threshold * pressure,
            release=placed.patch.release * pressure,
            noise=placed.patch.noise * pressure,
        )
        patches.append(replace(placed, patch=patch, s=placed.s * length, a=placed.a * length))
    link = arm.links[0]
    s = link.surface
    surface = replace(
        s,
        length=s.length * length,
        radius=s.radius * (length if s.period else 1.0),
        period=s.period * length,
        width=s.width * length,
    )
    return Arm("scaled", [Link(link.name, surface)], patches)


@levels
@laws
@pytest.mark.parametrize("surface", ["plane", "cylinder", "frustum"])
@pytest.mark.parametrize(("length", "pressure"), [(4.0**-10, 4.0**10), (4.0**10, 4.0**-10), (4.0, 1.0)])
def test_powers_of_four_of_the_units_change_no_bit_of_the_places(level, law, surface, length, pressure):
    arm = Ground(surface, law).arm()
    pressures = readings_of(arm, 5)
    a = Estimator(arm, level).update(pressures, 0)
    b = Estimator(scaled(arm, length, pressure), level).update(pressures * pressure, 0)
    assert len(a) == 2
    if law == "cone" and level == "kmeans":  # its place does not go through the logarithm of the force
        assert np.array_equal(a.s * length, b.s)
        assert np.array_equal(a.a * length, b.a)
    force = pressure * length**2
    assert_same(columns(a), columns(b), scale=length, force=force, factor=1e-3)


@levels
@laws
@FEW
@given(seed=SEEDS, length=st.floats(-6.0, 6.0), pressure=st.floats(-6.0, 6.0))
@example(seed=422, length=1.0, pressure=0.0)
@example(seed=2, length=-6.0, pressure=6.0)
@example(seed=2, length=6.0, pressure=-6.0)
@example(seed=2, length=6.0, pressure=6.0)
@example(seed=2, length=-6.0, pressure=-6.0)
def test_contacts_scale_with_lengths_and_pressures(level, law, seed, length, pressure):
    arm = Ground("cylinder", law).arm()
    length, pressure = 10.0**length, 10.0**pressure
    pressures = readings_of(arm, seed)
    a = Estimator(arm, level).update(pressures, 0)
    b = Estimator(scaled(arm, length, pressure), level).update(pressures * pressure, 0)
    # the steps of a fit are bounded in units of which the board has between a half and two of its own
    assert_same(columns(a), columns(b), scale=length, force=pressure * length**2, sigma=UNIT_SIGMA)


@levels
@laws
@FEW
@given(seed=SEEDS)
def test_a_board_split_in_two_feels_the_same(level, law, seed):
    # the fits use tactels, not boards; K-means clusters each board, so it may differ: its sum may not
    uv = grid(4, 4, 0.010)
    left = uv[:, 0] < 0.0
    ground = Ground("plane", law)
    one = ground.board(uv)
    whole = one.patches[0]
    halves = [
        replace(
            whole,
            node_id=n + 1,
            s=whole.s + (-0.0125 if side is left else 0.0125),
            patch=replace(
                whole.patch,
                tactels_uv=uv[side] - [(-0.0125 if side is left else 0.0125), 0.0],
                size=(0.025, 0.050),
            ),
        )
        for n, side in enumerate((left, ~left))
    ]
    two = Arm("halves", one.links, halves)
    rng = np.random.default_rng(seed)
    touch = (0, whole.s + rng.uniform(-0.012, 0.012), whole.a + rng.uniform(-0.012, 0.012), 8.0)
    pressures = pressures_under(one, [touch]) + 200.0 * rng.standard_normal(16)
    order = np.concatenate([np.flatnonzero(left), np.flatnonzero(~left)])
    a = columns(Estimator(one, level).update(pressures, 0))
    b = columns(Estimator(two, level).update(pressures[order], 0))
    assert len(a) == len(b) == 1
    if level == "kmeans":
        assert np.abs(a[:, 1:3] - b[:, 1:3]).max() <= 1e-12
        assert np.allclose(a[:, 3], b[:, 3], rtol=1e-12)
    else:
        assert_same(a, b)
