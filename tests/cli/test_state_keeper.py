"""A state is copied in the cycle and written elsewhere, at a bounded rate; one of unknown age is not used."""

from types import SimpleNamespace

import numpy as np
import pytest

from skinbus.cli import state_keeper
from skinbus.cli.state_keeper import WRITE_EVERY_S, keep_state
from skinbus.config.state_file import StateFile
from skinbus.config.system import load_arm
from skinbus.estimate import Baseline, Plausibility, Tracker
from skinbus.master.memory import Memory


class Kept:
    """A keeper of a small arm on a clock of its own."""

    def __init__(self, path, monkeypatch):
        arm = load_arm("pad")
        self.baseline = Baseline(arm)
        self.cycle = SimpleNamespace(
            zeroed_serials=np.zeros(1),
            arm=arm,
            baseline=self.baseline,
            plausibility=Plausibility(arm),
            tracker=Tracker(arm),
            keep_zero=int,
        )
        self.t, self.wall, self.said, self.n_saved = 0.0, 5e8, [], 0
        clock = SimpleNamespace(
            monotonic=lambda: self.t,
            time=lambda: self.wall + self.t,
        )
        monkeypatch.setattr(state_keeper, "time", clock)
        save = StateFile.save

        def counted(file, state):
            self.n_saved += 1
            save(file, state)

        monkeypatch.setattr(StateFile, "save", counted)
        self.begin = lambda: keep_state(path, Memory(self.cycle), arm, self.said.append)
        self.keeper = self.begin()

    def run(self, seconds, step=0.1, each=lambda: None):
        for _ in range(round(seconds / step)):
            self.t += step
            each()
            self.keeper.take(None)
            self.keeper.write()


@pytest.fixture
def kept(tmp_path, monkeypatch):
    return Kept(tmp_path / "state", monkeypatch)


def test_the_state_is_written_at_a_bounded_rate_and_never_older_than_a_zero_lasts(kept):
    """A master may be killed at any time, while a finger stays too."""
    ages, since = [], []

    def age():
        since.append(kept.t)
        if kept.n_saved > len(ages):
            ages.append(since[-1] - since[0])
            since.clear()

    kept.run(180.0, each=age)
    assert 180.0 / WRITE_EVERY_S <= kept.n_saved <= 180.0 / WRITE_EVERY_S + 2
    assert max(ages) < 2 * WRITE_EVERY_S


def test_a_master_that_lives_for_three_seconds_leaves_a_new_state(kept):
    kept.run(3.0)
    assert kept.n_saved == 1


def test_what_was_kept_is_taken_up_and_said(kept):
    kept.run(20.0)
    kept.keeper.write(at_end=True)
    kept.begin()
    assert "taken up" in kept.said[-1]
    kept.wall -= 1000.0  # set back
    kept.begin()
    assert "its age is not known" in kept.said[-1]


def test_a_full_disk_is_said_once_and_does_no_harm(kept, monkeypatch):
    def full(file, state):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(StateFile, "save", full)
    kept.run(2000.0, step=0.5)
    assert len(kept.said) == 1
