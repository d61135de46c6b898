"""A listener shows what a master publishes, and nothing that it does not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skinbus.cli.commands.monitor import line_of
from skinbus.config.system import load_arm
from skinbus.estimate import TrackState
from skinbus.master.patches.table import PatchState
from skinbus.skin.cycle import CONTACT, fill_places
from skinbus.skin.master_cycles import CycleMaker
from skinbus.view.unrolled import LOST, Unrolled
from tests.master.heard import listen
from tests.master.rig import Rig
from tests.skin.scenes import write
from tests.skin.scripted import made_cycle


@pytest.fixture
def listening(tmp_path):
    """A rig, a listener on its wire, and the cycles that it has heard."""
    rig = Rig(write(tmp_path), level="fit")
    core, feed = listen(rig)
    heard = []

    def run(ms):
        rig.run(ms)
        while cycle := feed.get(heard[-1].number + 1 if heard else 1, 0.0):
            heard.append(cycle)
        return heard

    return rig, core, run


def test_each_cycle_is_heard_once_with_the_contacts_that_were_published(listening):
    rig, _, run = listening
    heard = run(1000)
    reports = rig.reports[: len(heard)]
    assert len(rig.reports) - len(heard) <= 1
    for cycle, report in zip(heard, reports, strict=True):
        assert (cycle.counter, cycle.level, cycle.flags) == (report.counter, report.level, report.flags)
        assert abs(cycle.t_ns - report.t_ns) < 1_000_000
        tracks, records = report.tracks, cycle.records
        published = np.where(tracks.state == TrackState.MOVE, TrackState.HELD, tracks.state)
        assert_array_equal([records["id"], records["state"]], [tracks.id, published])
        assert_allclose([records["s"], records["a"]], [tracks.s, tracks.a], rtol=0.0, atol=6e-5)
        force = np.where(tracks.state == TrackState.LIFT, 0.0, tracks.force)
        assert_allclose(records["force"], force, rtol=0.0, atol=6e-3)
        for contact in cycle.contacts:
            assert contact.link == "plate"
            assert contact.covariance is contact.quality is contact.level is None


@pytest.mark.slow
def test_readings_are_the_pressures_that_the_master_has(listening):
    rig, core, run = listening
    heard = run(700)
    pairs = list(zip(heard, rig.reports, strict=False))[10:]
    assert all(cycle.readings.valid.all() for cycle, _ in pairs)
    for cycle, report in pairs:
        assert np.abs(cycle.readings.pressures - report.pressures).max() < 50.0
    assert max(cycle.readings.pressures.max() for cycle, _ in pairs) > 10e3
    core.readings.zero(None)
    assert np.abs(run(40)[-1].readings.pressures).max() < 5e3
    rig.patches.unplugged.add(1)
    assert not run(100)[-1].readings.valid.any()


def test_a_reading_that_is_not_used_is_not_valid(listening):
    """Some are at the lower rail: that is no fault of their tactels yet."""
    rig, _, run = listening
    run(700)
    rig.patches.changes[1] = lambda tpdo, counts: [-0x8000] * 4 if tpdo else counts
    heard, made = run(20)[-1], CycleMaker(rig.scene.arm).make(rig.master, rig.reports[-1])
    for readings in (heard.readings, made.readings):
        assert readings.valid.tolist() == [True] * 4 + [False] * 12
        assert np.isfinite(readings.pressures).all()
    assert Unrolled(rig.scene.arm, 80).render(heard).plain.count(LOST) == 12


def test_a_cycle_is_handed_on_when_its_last_contact_has_come(listening):
    """Not when the next one begins."""
    rig, _, run = listening
    heard = run(505)
    assert len(heard) == len(rig.reports) == 50
    assert heard[-1].contacts[0].seen_ns == heard[-1].t_ns


def test_what_was_heard_is_as_old_as_its_frames_by_who_was_held_up(listening):
    rig, core, run = listening
    run(505)
    core.step(5 * rig.wire.now_ns, rig.frames)
    assert abs(run(0)[-1].t_ns - rig.reports[-1].t_ns) < 1_000_000


def test_patches_are_what_was_heard_of_them(listening):
    rig, _, run = listening
    (patch,) = run(30)[0].patches
    assert patch.state is PatchState.ABSENT or patch.state is PatchState.BOOTING
    (patch,) = run(400)[-1].patches
    assert (patch.node_id, patch.state, patch.emcy) == (1, PatchState.OPERATIONAL, 0)
    rig.patches.unplugged.add(1)
    (patch,) = run(200)[-1].patches
    assert patch.state is PatchState.SILENT
    assert 0.1 < patch.age_s < 0.3


def test_a_contact_of_another_arm_is_at_no_point_of_this_one():
    records = np.zeros(2, CONTACT)
    records["link"], records["s"] = [0, 3], 0.02
    fill_places(records, load_arm("pad"))
    assert np.isfinite(records["point"][0]).all()
    for name in ("point", "normal"):
        assert np.isnan(records[name][1]).all()
    assert "NaN" not in line_of(made_cycle(1, 0, records=records)), "that is no JSON"


def test_a_zero_is_asked_of_the_master(listening):
    rig, core, run = listening
    run(500)
    request = core.ask_zero(None)
    run(100)
    assert request.done.is_set()
    request.client.result.unwrap()
    assert np.abs(rig.reports[-1].pressures).max() < 15e3
    assert any(event.kind.name == "ZEROED" for event in rig.events)
