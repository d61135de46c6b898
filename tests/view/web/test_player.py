"""A source is followed cycle by cycle; a recording is played to where it is wanted."""

import threading
import time

import numpy as np
import pytest

import skinbus
from skinbus.can.candump import CandumpWriter
from skinbus.errors import ConfigError, ShareError
from skinbus.view.web.player import Follower, History, Player
from tests.cli.patience import PATIENCE_S
from tests.master.rig import Rig
from tests.skin.scenes import write
from tests.view.web.cycles import made_cycle


def test_forces_are_the_largest_of_each_tenth_of_a_second():
    history = History()
    for n in range(1, 101):
        history.take(made_cycle(n, [{"id": 9, "force": 0.1 * n}]))
    times, ids, forces = history.forces(4)
    assert ids == [9]
    assert times[-1] == 0.0
    assert forces[-1, 0] == pytest.approx(10.0)
    assert forces[-3, 0] == pytest.approx(9.0)
    assert not forces[:-21].any()
    assert history.latencies() == pytest.approx(np.full(100, 5e-3))


def test_ids_seen_last_are_shown_and_old_ones_leave_after_twenty_seconds():
    history = History()
    for n in range(1, 1500):
        history.take(made_cycle(n, [{"id": 1 + n // 100, "force": 1.0}]))
    assert history.forces(3)[1] == [13, 14, 15]
    assert len(history.forces(100)[1]) == 10
    for n in range(1500, 2600):
        history.take(made_cycle(n))
    assert history.forces(3)[1] == []
    assert len(history.latencies()) == 1000


def test_lost_cycles_are_counted_and_a_new_source_is_no_loss():
    history = History()
    for n in (1, 2, 5, 6, 1, 2):
        history.take(made_cycle(n))
    assert history.n_lost == 2


class Source:
    """A skin that has these cycles."""

    pace = 1.0

    def __init__(self, *cycles, error=None):
        self._cycles, self._error = cycles, error
        self.zeroed, self.n_closed = [], 0

    def __iter__(self):
        yield from self._cycles
        if self._error:
            raise self._error

    def zero(self, patch):
        self.zeroed.append(patch)

    def close(self):
        self.n_closed += 1


def until(holds):
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end
        threading.Event().wait(0.002)


def test_source_that_ends_is_over():
    source = Source(made_cycle(1), made_cycle(2))
    follower = Follower(lambda: source)
    until(lambda: follower.has_ended)
    assert (follower.n_cycles, follower.newest.number, follower.error) == (2, 2, None)
    follower.zero(3)
    follower.close()
    assert (source.zeroed, source.n_closed) == ([3], 1)


def test_source_is_opened_again_and_what_ended_it_is_forgotten_when_it_is_back():
    done = threading.Event()

    class Last(Source):
        def __iter__(self):
            yield made_cycle(1)
            done.wait(PATIENCE_S)

    sources = [Source(made_cycle(1), error=ShareError("it has died")), Last()]

    def opening():
        if not sources:
            raise ShareError("there is none")
        return sources.pop(0)

    follower = Follower(opening, again_s=0.01)
    until(lambda: follower.n_opened == 2 and follower.n_cycles == 2)
    assert follower.error is None
    done.set()
    until(lambda: follower.error is not None)
    assert not follower.has_ended
    follower.close()
    assert follower.has_ended


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A recording of a second."""
    folder = tmp_path_factory.mktemp("field")
    rig = Rig(write(folder), level="fit")
    with CandumpWriter(folder / "field.log") as writer:
        rig.wire.tap(writer)
        rig.run(1000)
    return folder / "field.log"


def player_of(log):
    player = Player(skinbus.replay(log, "pad"))
    until(lambda: player.is_complete)
    return player


@pytest.fixture(scope="module")
def player(log):
    player = player_of(log)
    assert player.error is None
    yield player
    player.close()


@pytest.mark.slow
def test_player_has_the_cycles_of_the_recording(player, log):
    with skinbus.replay(log, "pad") as skin:
        cycles = list(skin)
    assert player.n_cycles == len(cycles)
    for k, cycle in enumerate(cycles):
        kept = player[k]
        for name in ("number", "t_ns", "counter", "level"):
            assert getattr(kept, name) == getattr(cycle, name)
        assert kept.records.tobytes() == cycle.records.tobytes()
        assert kept.readings.pressures == pytest.approx(cycle.readings.pressures, rel=1e-6)
        player.seek(player.seconds_of(k))
        assert player.number == k


def test_player_goes_to_where_it_is_sent(player):
    player.play()
    player.seek(0.0)
    player.advance(0.2)
    number = player.number
    assert player.newest.number == number + 1
    assert player.seconds_of(number) == pytest.approx(0.2, abs=0.011)
    player.speed = 0.5
    player.advance(0.2)
    assert player.seconds == pytest.approx(0.3)
    number = player.number
    player.step(-1)
    assert player.newest.number == number
    player.advance(1.0)
    assert player.newest.number == number
    player.seek(1e9)
    assert player.has_ended
    player.play()
    assert player.seconds == 0.0
    player.seek(0.45)
    assert len(player.newest.contacts) == 1
    assert player.history.forces(6)[1] == [1]
    player.seek(0.05)
    assert player.newest.contacts == ()
    assert player.history.forces(6)[1] == []


def test_fault_of_a_recording_ends_the_making(log, tmp_path):
    path = tmp_path / "other.log"
    lines = [line for line in log.read_text().splitlines() if " 080#" in line]
    path.write_text("\n".join(lines) + "\n")
    player = player_of(path)
    assert isinstance(player.error, ConfigError)
    player.close()
