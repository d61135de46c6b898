"""A simulated skin: the same cycles every time, as fast as they are asked for, or in real time."""

import numpy as np
import pytest

import skinbus
from skinbus.estimate import Quality, TrackState
from skinbus.master.patches.table import PatchState
from tests.skin.scenes import write


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write(tmp_path_factory.mktemp("scene"))


def test_a_contact_has_all_that_the_master_found(scene):
    said = []
    with skinbus.simulate(scene) as skin:
        for kind in ("touch", "move", "lift"):
            skin.on(kind, lambda contact, kind=kind: said.append((kind, contact.id)))
        cycles = list(skin)
        assert skin.n_lost == 0
        assert [patch.state for patch in skin.patches] == [PatchState.OPERATIONAL]
    assert [cycle.number for cycle in cycles] == list(range(1, len(cycles) + 1))
    assert 99 <= len(cycles) <= 101
    assert said == [("touch", 1), ("move", 1), ("lift", 1)]

    (cycle,) = (c for c in cycles if abs(c.t_ns - 0.5e9) < 1e6)
    (contact,) = cycle.contacts
    assert (contact.link, contact.state, contact.level) == ("plate", TrackState.MOVE, "fit")
    assert abs(contact.s - 0.025) < 1e-3
    assert contact.point == pytest.approx([contact.s, contact.a, 0.0])
    assert contact.normal.tolist() == [0.0, 0.0, 1.0]
    assert contact.covariance.shape == (3, 3)
    assert np.linalg.eigvalsh(contact.covariance).min() > 0.0
    assert isinstance(contact.quality, Quality)
    assert contact.age_s == cycle.age_s == pytest.approx(cycle.latency_s)
    readings = cycle.readings
    assert readings.valid.all()
    assert readings.pressures.shape == (16,)
    assert readings.pressures.max() > 10e3
    assert not readings.faults.any()


def test_at_level_kmeans_no_covariance_is_claimed(scene):
    with skinbus.simulate(scene, level="kmeans") as skin:
        contacts = [contact for cycle in skin for contact in cycle.contacts]
    assert contacts
    assert all(contact.covariance is None and contact.level in ("kmeans", None) for contact in contacts)


@pytest.mark.slow
def test_in_real_time_cycles_come_by_themselves(scene):
    with skinbus.simulate(scene, realtime=True) as skin:
        first, second = next(skin), next(skin)
        assert (first.number, second.number) == (1, 2)
        assert skin.latest().number >= 2
        assert 0.0 <= skin.latest().age_s < 60.0


def test_a_zero_makes_what_presses_nothing(scene):
    with skinbus.simulate(scene) as skin:
        while not skin.latest().contacts:
            pass
        skin.zero()
        assert skin.latest().readings.pressures.max() < 5e3
