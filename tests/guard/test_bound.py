"""What `python -m tests.bench.guard` measures: the bound holds, and a stop has a reason and comes in time."""

from functools import partial

import pytest

from skinbus.objects.cia import NMT_COMMAND_ID
from skinbus.objects.guard import GFC_ID
from tests.bench.guard_trials import ARMS, Trials, play_faults, play_quiet

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", ARMS)
def test_the_bound_is_kept_and_not_much_more_than_the_worst(tmp_path, name):
    trials = Trials(tmp_path, name, 50.0)
    presses = [trials.random] * 4 + [trials.at_once]
    presses += [partial(trials.worst, hit_id) for hit_id in (None, GFC_ID, NMT_COMMAND_ID)] * 4
    worst_ns = max(press()[0] for press in presses)
    assert worst_ns <= trials.bound_ns <= 1.5 * worst_ns
    assert trials.bound_ns < 2_000_000


def test_what_is_pressed_too_hard_while_it_guards_is_a_stop_in_time_whatever_fails(tmp_path):
    _, n_crossings, wrong = play_faults(tmp_path, 400, 0)
    assert n_crossings > 200
    assert not wrong


def test_ordinary_work_with_drift_and_noise_is_no_stop(tmp_path):
    n_samples, largest, reason = play_quiet(tmp_path, 2.0)
    assert n_samples > 40_000
    assert largest > 0.1
    assert not reason
