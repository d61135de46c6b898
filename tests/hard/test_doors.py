"""What stands at the doors: boards and times that cannot be, full scale as counts give it, any arrays."""

import math
import re

import numpy as np
import pytest

from skinbus.errors import EdsError
from skinbus.estimate import LEVELS, Baseline, Estimator, Quality, Tracker
from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Surface, Transducer, grid
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from tests.hard.check import check_contacts, off_skin
from tests.hard.ground import FULL_SCALE, NOISE, PITCH, law_of, pressures_under

UV = grid(4, 4, PITCH)
PERIOD_NS = 20_000_000


def board(**settings):
    """One flat board at the origin."""
    return Arm.single_patch(UV, law=law_of("cone"), **settings)


# --- Boards that cannot be --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "settings",
    [
        {"noise": math.nan},
        {"noise": -1.0},
        {"noise": np.array([math.inf] * 16)},
        {"threshold": math.nan},
        {"threshold": -1.0},
        {"release": math.inf},
        {"gain": np.full(16, math.nan)},
        {"gain": np.full(16, 1e200)},
        {"gain": np.ones(15)},
        {"offset": np.full(16, math.inf)},
        {"healthy": np.ones(3, np.bool_)},
        {"size": (0.0, 0.05)},
        {"size": (math.nan, 0.05)},
        {"diameter": 0.0},
        {"tactels_uv": grid(4, 4, 1e150)},
        {"tactels_uv": np.ma.masked_array(UV, UV > 0.01)},
        {"gain": np.ma.masked_array(np.ones(16), np.arange(16) > 8)},
        {"tactels_uv": np.zeros((0, 2))},
        {"tactels_uv": np.zeros((65, 2))},
        {"tactels_uv": np.full((4, 2), math.nan)},
        {"tactels_uv": np.zeros(4)},
    ],
    ids=str,
)
def test_a_board_that_cannot_be_is_refused(settings):
    with pytest.raises(ValueError, match=r"must be|could not be broadcast|must not"):
        Patch(**{"tactels_uv": UV, **settings})


@pytest.mark.parametrize("full_scale", [0.0, -1.0, math.nan, math.inf, 1e-40, 1e40])
def test_a_full_scale_that_cannot_be_is_refused(full_scale):
    with pytest.raises(ValueError, match="full_scale must be"):
        Transducer(full_scale=full_scale)


@pytest.mark.parametrize("bits", [1, 33])
def test_bits_that_cannot_be_are_refused(bits):
    with pytest.raises(ValueError, match="bits must be"):
        Transducer(full_scale=1.0, bits=bits)


def test_surfaces_and_places_that_cannot_be_are_refused():
    for build in (
        lambda: Surface.plane(math.nan, 1.0),
        lambda: Surface.cylinder(0.1, 0.0),
        lambda: Surface.cylinder(0.1, math.inf),
        lambda: Surface.cone(0.1, 0.3, 0.1),  # steeper than a plane
    ):
        with pytest.raises(ValueError, match="wanted positive lengths"):
            build()
    links = [Link("plate", Surface.plane(1.0, 1.0))]
    for at in ({"link": 1}, {"link": -1}, {"s": math.nan}, {"a": math.inf}, {"yaw": math.nan}):
        placed = PlacedPatch(
            **{"patch": Patch(tactels_uv=UV), "node_id": 1, "link": 0, "s": 0.1, "a": 0.0, **at}
        )
        with pytest.raises(ValueError, match=r"wanted|place and yaw must be"):
            Arm("nowhere", links, [placed])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e38])
@pytest.mark.parametrize("name", ["Noise Pa", "Cone slope", "Force exponent"])
def test_numbers_in_an_eds_that_are_none_are_named(name, value):
    od = load_eds("skin-patch", 1)
    members = {v.name: v for o in od.values() for v in getattr(o, "values", list)()}
    variable, kind = members[name], members["Law kind"]
    old = variable.value
    before, kind.value = kind.value, 0  # the cone, which is the law that has a slope
    variable.value = value
    try:
        with pytest.raises(EdsError, match=re.escape(name)):
            describe_patch(od)
    finally:
        kind.value = before
        variable.value = old


# --- Full scale -------------------------------------------------------------------------------------


def test_a_reading_at_the_end_of_the_counts_is_saturated_however_far_its_zero_is_off():
    offset = np.full(16, 700.0)
    arm = board(offset=offset)
    estimator = Estimator(arm, "full")
    pressures = pressures_under(arm, [(0, 0.005, 0.005, 5.0)])
    pressures[10] = (32767 - offset[10]) * arm.patches[0].patch.transducer.step
    for level in LEVELS[1:]:
        assert estimator.update(pressures, 0, level=level)[0].quality & Quality.SATURATED


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("value", [FULL_SCALE, 5e5, 1e300])
def test_a_zero_taken_at_full_scale_leaves_a_tactel_with_nothing_to_say(level, value):
    arm = board()
    estimator, baseline = Estimator(arm, level), Baseline(arm)
    readings = np.full(16, value)
    baseline.apply(readings.copy(), 0)
    baseline.zero()
    baseline.apply(readings.copy(), PERIOD_NS)
    assert np.abs(baseline.zeros).max() <= 1.001 * FULL_SCALE
    for n in range(2, 5):
        pressures = readings.copy()
        pressures[:8] += 1e3 * n
        baseline.apply(pressures, n * PERIOD_NS)
        assert len(estimator.update(pressures, n * PERIOD_NS, baseline=baseline)) == 0


@pytest.mark.parametrize("level", LEVELS)
def test_a_gain_of_zero_makes_a_dead_tactel(level):
    gain = np.ones(16)
    gain[[0, 15]] = 0.0
    arm, dead = board(gain=gain), board(healthy=gain > 0.0)
    pressures = pressures_under(arm, [(0, 0.004, 0.003, 5.0)])
    pressures[[0, 15]] = 1000.0
    a, b = (Estimator(x, level).update(pressures, 0) for x in (arm, dead))
    assert len(a) == 1
    assert np.array_equal(a.s, b.s)
    assert np.array_equal(a.covariance, b.covariance)
    assert a.quality[0] == b.quality[0] == 0


# --- Places -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("gap", [0.0, 5e-3, 12e-3])
def test_a_contact_that_three_boards_feel_is_on_one_of_them(level, gap):
    # boards around a hole: the centroid of their clusters is in it
    patch = Patch(tactels_uv=UV, law=Cone(2e5))
    step = 0.050 + gap
    places = [(0.1, 0.0), (0.1 + step, 0.0), (0.1, step)]
    placed = [PlacedPatch(patch=patch, node_id=n + 1, link=0, s=s, a=a) for n, (s, a) in enumerate(places)]
    arm = Arm("hole", [Link("plate", Surface.plane(0.4, 0.4))], placed)
    hole = (0, 0.1 + 0.5 * step + 6e-3, 0.5 * step + 6e-3, 300.0)
    contacts = Estimator(arm, level).update(np.minimum(pressures_under(arm, [hole]), FULL_SCALE), 0)
    assert len(contacts) >= 1
    assert max(off_skin(arm, c.link, c.s, c.a) for c in contacts) <= 1e-9
    assert not check_contacts(arm, contacts, level)


# --- Times and arrays -------------------------------------------------------------------------------


@pytest.mark.parametrize("t_ns", [2**63, -(2**62), 3 * 2**61])
def test_times_whose_differences_are_no_numbers_are_refused_at_every_door(t_ns):
    arm = board()
    contacts = Estimator(arm).update(np.zeros(16), 0)
    for door in (
        lambda: Estimator(arm).update(np.zeros(16), t_ns),
        lambda: Tracker(arm).update(contacts, t_ns),
        lambda: Baseline(arm).apply(np.zeros(16), t_ns),
    ):
        with pytest.raises(ValueError, match="t_ns must be"):
            door()


@pytest.mark.parametrize("t_ns", [0.5, "0", None])
def test_times_that_are_no_integers_are_refused_at_every_door(t_ns):
    arm = board()
    contacts = Estimator(arm).update(np.zeros(16), 0)
    for door in (
        lambda: Estimator(arm).update(np.zeros(16), t_ns),
        lambda: Tracker(arm).update(contacts, t_ns),
        lambda: Baseline(arm).apply(np.zeros(16), t_ns),
    ):
        with pytest.raises(TypeError):
            door()


def test_a_step_over_the_whole_range_of_times_is_taken():
    arm = board()
    estimator, tracker, baseline = Estimator(arm, "fit"), Tracker(arm), Baseline(arm)
    identities = []
    for t_ns in (-(2**61), 3 * 2**61 - 1, -(2**61), 0, 0, np.int64(5)):
        pressures = pressures_under(arm, [(0, 0.002, 0.001, 5.0)])
        baseline.apply(pressures, t_ns)
        tracks = tracker.update(estimator.update(pressures, t_ns), t_ns)
        assert np.isfinite(tracks.mean).all()
        assert np.isfinite(tracks.covariance).all()
        identities.append(tracks.identity[tracks.row >= 0].tolist())
    # after the gap it is another one, a clock set back is no gap
    assert identities == [[1], [2], [2], [3], [3], [3]]


@pytest.mark.parametrize("kind", ["strided", "reversed", "fortran", "float32", "list", "int"])
def test_arrays_of_any_kind_give_the_same_answer(kind):
    arm = board()
    estimator = Estimator(arm, "fit")
    pressures = np.rint(pressures_under(arm, [(0, 0.002, 0.001, 5.0)]))
    other = {
        "strided": np.repeat(pressures, 3)[::3],
        "reversed": pressures[::-1].copy()[::-1],
        "fortran": np.asfortranarray(np.stack([pressures, pressures]))[0],
        "float32": pressures.astype(np.float32),
        "list": pressures.tolist(),
        "int": pressures.astype(np.int32),
    }[kind]
    a, b = estimator.update(pressures, 0), estimator.update(other, 0)
    assert np.array_equal(a.s, b.s)
    assert np.array_equal(a.covariance, b.covariance)


def test_a_baseline_works_in_place_on_arrays_that_are_not_contiguous():
    arm = board()
    one, other = Baseline(arm), Baseline(arm)
    rng = np.random.default_rng(3)
    for n in range(60):
        pressures = 300.0 + NOISE * rng.standard_normal(16)
        apart = np.repeat(pressures, 2)[::2]
        one.apply(pressures, n * PERIOD_NS)
        other.apply(apart, n * PERIOD_NS)
        assert np.array_equal(pressures, apart)
    assert one.zeros.any()


def test_numbers_of_contacts_and_of_work_may_be_of_any_size():
    arm = board()
    pressures = pressures_under(arm, [(0, 0.002, 0.001, 5.0)])
    for settings in ({"k": 10**30}, {"budget_work": 10**30}, {"seed": -(10**30), "start": "random", "k": 2}):
        assert len(Estimator(arm, "fit", **settings).update(pressures, 0)) >= 1
    for settings in ({"k": 2.0}, {"budget_work": 0.5}):
        with pytest.raises(TypeError):
            Estimator(arm, **settings)
