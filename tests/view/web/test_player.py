"""A film is played to where it is wanted, and what was published then stands beside it."""

import time

import numpy as np
import pytest

import skinbus
from skinbus.can.candump import CandumpWriter
from skinbus.errors import ConfigError, LocalProtocolError
from skinbus.skin.film import Film
from skinbus.view.web.drawing import Drawer
from skinbus.view.web.player import FilmPlayer
from skinbus.view.web.poses import in_a_row
from tests.cli.patience import PATIENCE_S
from tests.master.rig import Rig
from tests.skin.scenes import write


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A recording of a second, with a mark in its middle."""
    folder = tmp_path_factory.mktemp("field")
    rig = Rig(write(folder), level="fit")
    with CandumpWriter(folder / "field.log") as writer:
        rig.wire.tap(writer)
        rig.run(500)
        writer.mark(1, rig.wire.clock.now_ns())
        rig.run(500)
    return folder / "field.log"


@pytest.fixture(scope="module")
def film(log):
    film = Film(log, "pad")
    end = time.monotonic() + PATIENCE_S
    while not film.is_complete:
        assert time.monotonic() < end
        time.sleep(0.01)
    assert film.error is None
    yield film
    film.close()


@pytest.mark.slow
def test_film_has_the_cycles_of_the_recording(film, log):
    with skinbus.replay(log, "pad") as skin:
        for k, cycle in enumerate(skin):
            kept = film[k]
            assert (kept.number, kept.t_ns, kept.counter, kept.level) == (
                cycle.number,
                cycle.t_ns,
                cycle.counter,
                cycle.level,
            )
            assert kept.records.tobytes() == cycle.records.tobytes()
            assert kept.readings.pressures == pytest.approx(cycle.readings.pressures, rel=1e-6)
            assert film.at(film.seconds_of(k)) == k
    assert len(film) == k + 1


def test_what_was_published_stands_beside_what_is_made(film):
    compared = 0
    for k in range(len(film)):
        cycle = film[k]
        if cycle.published is None:
            continue
        made = {c.id: c for c in cycle.contacts}
        assert set(cycle.published["id"].tolist()) == set(made)
        for record in cycle.published:
            assert record["s"] == pytest.approx(made[record["id"]].s, abs=6e-5)
            assert record["point"] == pytest.approx(np.asarray(made[record["id"]].point), abs=1e-4)
            compared += 1
    assert compared > 30
    drawer = Drawer(film.arm, in_a_row(film.arm))
    drawing = drawer.draw(film[film.at(0.4)])
    assert len(drawing.published) > 1


def test_marks_are_where_they_were_set(film):
    ((number, seconds),) = film.marks
    assert number == 1
    assert film.seconds_of(film.at(seconds)) == pytest.approx(seconds, abs=0.011)
    assert seconds == pytest.approx(0.5 - 1e-9 * film.begin_ns, abs=0.02)


def test_player_goes_to_where_it_is_sent(film):
    player = FilmPlayer(film)
    player.advance(0.2)
    assert player.newest.number == film.at(0.2) + 1
    player.speed = 0.5
    player.advance(0.2)
    assert player.seconds == pytest.approx(0.3)
    player.step(-1)
    assert player.newest.number == film.at(0.3)
    player.advance(1.0)
    assert player.newest.number == film.at(0.3)
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


def test_recording_cannot_be_zeroed(film):
    with pytest.raises(LocalProtocolError):
        FilmPlayer(film).zero(None)


def test_fault_of_a_recording_ends_the_film_with_it(log, tmp_path):
    path = tmp_path / "other.log"
    lines = [line for line in log.read_text().splitlines() if " 080#" in line]
    path.write_text("\n".join(lines) + "\n")
    film = Film(path, "pad")
    end = time.monotonic() + PATIENCE_S
    while not film.is_complete:
        assert time.monotonic() < end
        time.sleep(0.01)
    assert isinstance(film.error, ConfigError)
    film.close()
