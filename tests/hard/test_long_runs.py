"""What only time brings out: rounding that adds up, counters that wrap, identities that come round again."""

import numpy as np
import pytest

from skinbus.estimate import Baseline, Estimator, Tracker
from skinbus.model import Arm, grid
from tests.hard.ground import PITCH, law_of, pressures_under

PERIOD_NS = 20_000_000
HELD, OTHER = (0, -0.012, -0.01, 5.0), (0, 0.012, 0.01, 5.0)


@pytest.fixture(scope="module")
def arm():
    return Arm.single_patch(grid(4, 4, PITCH), law=law_of("cone"))


def test_identity_of_a_held_contact_is_given_to_nobody_else(arm):
    # one byte on the wire: 255 of them come round every 256 touches
    estimator, tracker = Estimator(arm), Tracker(arm)
    alone, both = (estimator.update(pressures_under(arm, t), 0) for t in ([HELD], [HELD, OTHER]))
    first = tracker.update(alone, 0)
    turns, last = 0, 0
    for n in range(1, 1400):
        tracks = tracker.update(alone if n % 5 else both, n * PERIOD_NS)
        assert len(set(tracks.id.tolist())) == len(tracks)
        assert tracks.id[tracks.identity == first.identity[0]].tolist() == first.id.tolist()
        _, number = tracker.last
        turns += number < last
        last = number
    assert turns >= 1


@pytest.mark.parametrize("t0", [-(2**40), 2**31, 2**32, 10**18, 2**62])
def test_time_of_any_size_changes_no_bit(arm, t0):
    answers = []
    for start in (0, t0):
        estimator, tracker, baseline = Estimator(arm), Tracker(arm), Baseline(arm)
        rng = np.random.default_rng(4)
        for n in range(60):
            touches = [(0, 0.0002 * n, 0.001, 5.0)] if n > 40 else []
            pressures = pressures_under(arm, touches) + 50.0 * rng.standard_normal(16)
            t_ns = start + n * PERIOD_NS
            baseline.apply(pressures, t_ns)
            tracks = tracker.update(estimator.update(pressures, t_ns), t_ns)
        answers.append([*tracks.mean.ravel(), *tracks.covariance.ravel(), *baseline.zeros])
    assert answers[0] == answers[1]
