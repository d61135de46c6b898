"""`skinbus doctor health`: nothing to do for a healthy board, what to do for another."""

import numpy as np
import pytest

from skinbus.cli.state_keeper import health_file
from skinbus.master.health import SETTLED
from tests.cli.invoke import run
from tests.master.watched import Watched

pytestmark = pytest.mark.slow

SEED = 20261204


@pytest.fixture(scope="module")
def tables():
    watched = Watched(SEED)
    watched.settle()
    good = watched.tables()
    watched = Watched(SEED, tables=good)
    watched.noise = np.where(np.arange(16) < 3, 900.0, 200.0)
    watched.zero[:] = np.where(np.arange(16) == 7, -2300.0, 600.0)
    watched.run(400)
    return {"good": good, "bad": watched.tables()}


@pytest.fixture
def state(tmp_path):
    return tmp_path / "state"


def test_a_healthy_board_has_nothing_to_do_and_of_another_arm_nothing_is_known(tables, state):
    health_file(state).save(tables["good"])
    for arm, wanted in (("pad", "nothing to do"), ("forearm", "not commissioned yet")):
        assert wanted in run("doctor", "health", arm, "--state", state)


def test_a_board_that_was_seen_too_briefly_is_not_commissioned_yet(state):
    watched = Watched(SEED)
    watched.run(10 * SETTLED // 2)
    health_file(state).save(watched.tables())
    said = run("doctor", "health", "pad", "--state", state)
    assert "node 1: not commissioned yet" in said
    assert "5 min while the master runs" in said
    assert "nothing to do" not in said


def test_what_changed_is_named_with_what_to_do(tables, state):
    health_file(state).save(tables["bad"])
    said = run("doctor", "health", "pad", "--state", state, status=1)
    assert "node 1 tactels 1-3: noise 3 times that at commissioning" in said
    assert "node 1 tactel 8: zeros" in said
    assert "replace the board" in said
