"""What stands at the doors: boards and times that cannot be, full scale as counts give it, any arrays."""

import math
import re

import numpy as np
import pytest

from skinbus.errors import EdsError
from skinbus.estimate import Baseline, Estimator, Tracker
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface, Transducer, grid
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from tests.hard.ground import FULL_SCALE, PITCH, law_of, pressures_under
from tests.marks import levels

UV = grid(4, 4, PITCH)
PERIOD_NS = 20_000_000
FEELS = [(0, 0.002, 0.001, 5.0)]
"""Touches of one contact on the board below."""


def board(**settings):
    """One flat board at the origin."""
    return Arm.single_patch(UV, law=law_of("cone"), **settings)


# --- Boards that cannot be --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("noise", math.nan),
        ("noise", -1.0),
        ("noise", np.array([math.inf] * 16)),
        ("threshold", math.nan),
        ("threshold", -1.0),
        ("release", math.inf),
        ("gain", np.full(16, math.nan)),
        ("gain", np.full(16, 1e200)),
        ("gain", np.ones(15)),
        ("gain", np.ma.masked_array(np.ones(16), np.arange(16) > 8)),
        ("offset", np.full(16, math.inf)),
        ("healthy", np.ones(3, np.bool_)),
        ("size", (0.0, 0.05)),
        ("size", (math.nan, 0.05)),
        ("diameter", 0.0),
        ("tactels_uv", grid(4, 4, 1e150)),
        ("tactels_uv", np.ma.masked_array(UV, UV > 0.01)),
        ("tactels_uv", np.zeros((0, 2))),
        ("tactels_uv", np.zeros((65, 2))),
        ("tactels_uv", np.full((4, 2), math.nan)),
        ("tactels_uv", np.zeros(4)),
    ],
)
def test_a_board_that_cannot_be_is_refused(setting, value):
    with pytest.raises(ValueError, match=r"must be|could not be broadcast|must not"):
        Patch(**{"tactels_uv": UV, setting: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [*(("full_scale", v) for v in (0.0, -1.0, math.nan, math.inf, 1e-40, 1e40)), ("bits", 1), ("bits", 33)],
)
def test_a_transducer_that_cannot_be_is_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} must be"):
        Transducer(**{"full_scale": 1.0, name: value})


def place(**at):
    """The board at a place on a plate."""
    placed = {"patch": Patch(tactels_uv=UV), "node_id": 1, "link": 0, "s": 0.1, "a": 0.0, **at}
    return Arm("nowhere", [Link("plate", Surface.plane(1.0, 1.0))], [PlacedPatch(**placed)])


@pytest.mark.parametrize(
    "build",
    [
        lambda: Surface.plane(math.nan, 1.0),
        lambda: Surface.cylinder(0.1, 0.0),
        lambda: Surface.cylinder(0.1, math.inf),
        lambda: Surface.cone(0.1, 0.3, 0.1),  # steeper than a plane
        lambda: place(link=1),
        lambda: place(link=-1),
        lambda: place(s=math.nan),
        lambda: place(a=math.inf),
        lambda: place(yaw=math.nan),
    ],
)
def test_a_surface_or_place_that_cannot_be_is_refused(build):
    with pytest.raises(ValueError, match=r"wanted|place and yaw must be"):
        build()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e38])
@pytest.mark.parametrize("name", ["Noise Pa", "Cone slope", "Force exponent"])
def test_numbers_in_an_eds_that_are_none_are_named(name, value, monkeypatch):
    od = load_eds("skin-patch", 1)
    members = {v.name: v for o in od.values() for v in getattr(o, "values", list)()}
    monkeypatch.setattr(members["Law kind"], "value", 0)  # the cone, which is the law that has a slope
    monkeypatch.setattr(members[name], "value", value)
    with pytest.raises(EdsError, match=re.escape(name)):
        describe_patch(od)


# --- Full scale -------------------------------------------------------------------------------------


@levels
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
        pressures = readings + 1e3 * n * (np.arange(16) < 8)
        baseline.apply(pressures, n * PERIOD_NS)
        assert len(estimator.update(pressures, n * PERIOD_NS, baseline=baseline)) == 0


@levels
def test_a_gain_of_zero_makes_a_dead_tactel(level):
    gain = np.ones(16)
    gain[[0, 15]] = 0.0
    arm, dead = board(gain=gain), board(healthy=gain > 0.0)
    pressures = pressures_under(arm, [(0, 0.004, 0.003, 5.0)])
    pressures[[0, 15]] = 1000.0
    a, b = (Estimator(x, level).update(pressures, 0) for x in (arm, dead))
    assert a.quality.tolist() == b.quality.tolist() == [0]
    assert np.array_equal(a.s, b.s)
    assert np.array_equal(a.covariance, b.covariance)


# --- Times and arrays -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("t_ns", "error"),
    [
        *((t_ns, ValueError) for t_ns in (2**63, -(2**62), 3 * 2**61)),  # differences do not fit 64 bits
        *((t_ns, TypeError) for t_ns in (0.5, "0", None)),
    ],
)
def test_times_that_cannot_be_are_refused_at_every_door(t_ns, error):
    arm = board()
    contacts = Estimator(arm).update(np.zeros(16), 0)
    for door, value in (
        (Estimator(arm).update, np.zeros(16)),
        (Tracker(arm).update, contacts),
        (Baseline(arm).apply, np.zeros(16)),
    ):
        with pytest.raises(error, match="t_ns must be"):
            door(value, t_ns)


def test_a_step_over_the_whole_range_of_times_is_taken():
    arm = board()
    estimator, tracker, baseline = Estimator(arm, "fit"), Tracker(arm), Baseline(arm)
    identities = []
    for t_ns in (-(2**61), 3 * 2**61 - 1, -(2**61), 0, 0, np.int64(5)):
        pressures = pressures_under(arm, FEELS)
        baseline.apply(pressures, t_ns)
        tracks = tracker.update(estimator.update(pressures, t_ns), t_ns)
        assert np.isfinite(tracks.mean).all()
        assert np.isfinite(tracks.covariance).all()
        identities.append(tracks.identity[tracks.row >= 0].tolist())
    # after the gap it is another one, a clock set back is no gap
    assert identities == [[1], [2], [2], [3], [3], [3]]


@pytest.mark.parametrize(
    "change",
    [
        lambda p: np.repeat(p, 3)[::3],
        lambda p: p.astype(np.float32),
        lambda p: p.astype(np.int32),
        lambda p: p.tolist(),
    ],
    ids=["strided", "float32", "int", "list"],
)
def test_arrays_of_any_kind_give_the_same_answer(change):
    arm = board()
    estimator, pressures = Estimator(arm, "fit"), np.rint(pressures_under(arm, FEELS))
    a, b = estimator.update(pressures, 0), estimator.update(change(pressures), 0)
    assert np.array_equal(a.s, b.s)
    assert np.array_equal(a.covariance, b.covariance)
