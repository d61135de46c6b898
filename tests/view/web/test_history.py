"""Forces by id over twenty seconds and latencies, in rings that do not grow."""

import numpy as np
import pytest

from skinbus.view.web.history import N_LATENCIES, N_STEPS, History
from tests.view.web.cycles import MadeCycle


def test_forces_are_the_largest_of_each_tenth_of_a_second():
    history = History()
    for n in range(1, 101):
        history.take(MadeCycle(n, [{"id": 9, "force": 0.1 * n}]))
    times, ids, forces = history.forces(4)
    assert ids == [9]
    assert times[-1] == 0.0
    assert forces[-1, 0] == pytest.approx(10.0)
    assert forces[-3, 0] == pytest.approx(9.4)
    assert not forces[: N_STEPS - 21].any()


def test_ids_seen_last_are_shown_and_old_ones_leave_after_twenty_seconds():
    history = History()
    for n in range(1, 1500):
        contacts = [{"id": 1 + n // 100, "force": 1.0}]
        history.take(MadeCycle(n, contacts))
    _, ids, _ = history.forces(3)
    assert ids == [13, 14, 15]
    assert len(history.forces(100)[1]) == 10
    for n in range(1500, 2600):
        history.take(MadeCycle(n))
    assert history.forces(3)[1] == []


def test_lost_cycles_are_counted_and_a_new_source_is_no_loss():
    history = History()
    for n in (1, 2, 5, 6, 1, 2):
        history.take(MadeCycle(n))
    assert history.n_lost == 2


def test_latencies_are_those_of_the_last_cycles():
    history = History()
    for n in range(1, N_LATENCIES + 500):
        history.take(MadeCycle(n))
    assert len(history.latencies()) == N_LATENCIES
    assert history.latencies() == pytest.approx(np.full(N_LATENCIES, 5e-3))
