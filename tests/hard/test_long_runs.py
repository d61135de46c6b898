"""What only time brings out: rounding that adds up, counters that wrap, identities that come round again."""

import numpy as np
import pytest

from skinbus.estimate import Baseline, Estimator, Tracker, TrackState
from tests.hard.ground import Ground, pressures_under, touch

PERIOD_NS = 20_000_000


@pytest.fixture(scope="module")
def arm():
    ground = Ground("plane", "cone")
    return ground.mount([ground.arm().patches[0].patch])


def show(tracker, estimator, touches, t_ns):
    """Tracks after one cycle that feels these touches."""
    pressures = pressures_under(estimator.arm, touches)
    return tracker.update(estimator.update(pressures, t_ns), t_ns)


@pytest.mark.parametrize("counter", [2**8 - 2, 10**9, 2**31 - 2, 2**32 - 2, 2**53 - 1, 2**62])
def test_identities_go_on_past_every_width_of_a_counter(arm, counter):
    estimator, tracker = Estimator(arm), Tracker(arm)
    tracker.last = counter, 0
    here, there = touch(arm, 0, -0.012, -0.01, 5.0), touch(arm, 0, 0.012, 0.01, 5.0)
    seen = []
    for n in range(6):
        tracks = show(tracker, estimator, [here, there] if n % 3 else [], n * 10**9)
        seen += [
            i for i, state in zip(tracks.identity, tracks.state, strict=True) if state == TrackState.TOUCH
        ]
    assert seen == list(range(counter + 1, counter + 1 + len(seen)))
    assert len(seen) == 4


def test_identity_of_a_held_contact_is_given_to_nobody_else(arm):
    # one byte on the wire: 255 of them come round every 256 touches
    estimator, tracker = Estimator(arm), Tracker(arm)
    held, other = touch(arm, 0, -0.012, -0.01, 5.0), touch(arm, 0, 0.012, 0.01, 5.0)
    first = show(tracker, estimator, [held], 0)
    turns, last = 0, 0
    for n in range(1, 4000):
        tracks = show(tracker, estimator, [held, other] if n % 5 == 0 else [held], n * PERIOD_NS)
        assert len(set(tracks.id.tolist())) == len(tracks)
        assert first.identity[0] in tracks.identity
        assert tracks.id[tracks.identity == first.identity[0]] == first.id[0]
        _, number = tracker.last
        turns += number < last
        last = number
    assert turns >= 3


@pytest.mark.parametrize("t0", [0, -(2**40), 2**31, 2**32, 10**18, 2**62])
def test_time_of_any_size_changes_no_bit(arm, t0):
    answers = []
    for start in (0, t0):
        estimator, tracker, baseline = Estimator(arm), Tracker(arm), Baseline(arm)
        rng = np.random.default_rng(4)
        for n in range(60):
            spot = touch(arm, 0, 0.0002 * n, 0.001, 5.0)
            pressures = pressures_under(arm, [spot] if n > 40 else []) + 50.0 * rng.standard_normal(16)
            t_ns = start + n * PERIOD_NS
            baseline.apply(pressures, t_ns)
            tracks = tracker.update(estimator.update(pressures, t_ns), t_ns)
        answers.append([*tracks.mean.ravel(), *tracks.covariance.ravel(), *baseline.zeros])
    assert answers[0] == answers[1]
