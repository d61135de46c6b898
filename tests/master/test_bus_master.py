"""One master on several buses, on virtual time: node-IDs repeat, one cycle over all, each stands alone."""

from itertools import pairwise

import pytest

from skinbus.master.patches.table import PatchState
from skinbus.objects import cia
from skinbus.objects.cia import EmcyCode
from tests.master.buses_rig import (
    LEFT,
    MS,
    ON_LEFT,
    ON_RIGHT,
    ON_SEAM,
    RIGHT,
    BusesRig,
    contacts_in,
    write_scene,
)
from tests.master.faults_rig import emcy

pytestmark = pytest.mark.slow

SUMMARY_ID = 0x1FF


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    def make(*touches):
        return write_scene(tmp_path_factory.mktemp("buses"), touches)

    return make


@pytest.fixture
def rig(scenes):
    rig = BusesRig(scenes(ON_LEFT, ON_RIGHT), level="kmeans")
    rig.run(1500)
    return rig


def times(frames, cob_id):
    return [frame.t_ns for frame in frames if frame.can_id == cob_id]


def test_contacts_are_published_alike_on_every_bus(rig):
    _, _, (left, right) = rig.run(1000)
    assert contacts_in(left) == contacts_in(right)
    assert len(contacts_in(left)) == 2 * 50
    assert len(times(left, SUMMARY_ID)) == len(times(right, SUMMARY_ID)) == 50


def test_each_bus_shows_its_own_patches_and_says_on_which_bus_a_contact_is(rig):
    assert rig.get(LEFT, 0x2100, 3) == rig.get(RIGHT, 0x2100, 3) == 1
    for bus in (LEFT, RIGHT):
        told = {rig.get(bus, index, 0x22) for index in (0x3001, 0x3002)}
        assert told == {1, 2}
        assert {rig.get(bus, index, 9) for index in (0x3001, 0x3002)} == {1}


def test_patch_that_falls_silent_is_reported_on_its_bus_alone(rig):
    rig.wires.wires[RIGHT].detach(rig.patch_ports[RIGHT])
    _, events, (left, right) = rig.run(500)
    assert ("readings-lost", 1, RIGHT) in {(event.kind, event.node_id, event.bus) for event in events}
    assert {event.bus for event in events} == {RIGHT}
    assert emcy(left) == []
    assert (EmcyCode.RPDO_TIMEOUT, 1) in emcy(right)
    assert rig.get(LEFT, 0x2300, 1) == PatchState.OPERATIONAL
    assert rig.get(RIGHT, 0x2300, 1) == PatchState.SILENT


@pytest.mark.parametrize("lost", [LEFT, RIGHT])
def test_bus_that_is_lost_and_back_does_not_disturb_the_other(rig, lost):
    other = 1 - lost
    before, _, frames = rig.run(1000)
    at_ease = max(report.latency_ns for report in before)
    own = rig.scene.arm.patches[other]
    rig.lose(lost)
    reports, _, frames = rig.run(3000)
    syncs = times(frames[other], cia.SYNC_ID)
    assert len(syncs) == 150
    assert max(abs(b - a - 20 * MS) for a, b in pairwise(syncs)) < 0.3 * MS
    assert times(frames[lost], SUMMARY_ID) == []
    assert {report.n_fresh for report in reports} == {1}
    # No cycle waits for the bus that is not there; a heartbeat may come between.
    assert max(report.latency_ns for report in reports) <= at_ease + 0.3 * MS
    mine = [len(report.contacts) for report in reports]
    assert set(mine) == {1}
    assert abs(reports[-1].contacts.s[0] - own.s) < 0.026

    rig.plug_in(lost)
    reports, events, frames = rig.run(1000)
    assert {report.n_fresh for report in reports[5:]} == {2}
    assert [event.kind for event in events] == []
    assert EmcyCode.BUS_OFF_RECOVERED in {code for code, _ in emcy(frames[lost])}


def test_contact_across_a_seam_between_buses_is_one_contact(scenes):
    rig = BusesRig(scenes(ON_SEAM), level="fit")
    rig.run(1500)
    reports, _, _ = rig.run(500)
    pressed = reports[-1].pressures
    start = rig.scene.arm.patch_start
    touch = rig.scene.arm.tactel_threshold.max()
    assert pressed[: start[1]].max() > touch < pressed[start[1] :].max(), "both patches feel it"
    for report in reports:
        assert len(report.contacts) == 1
        assert 1e3 * report.contacts.s[0] == pytest.approx(ON_SEAM[0], abs=1.5)
        assert 1e3 * report.contacts.a[0] == pytest.approx(ON_SEAM[1], abs=1.5)
