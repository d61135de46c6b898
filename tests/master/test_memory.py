"""A master that is killed in a press comes back with the same zeros, contacts, identities and forces."""

import json
import struct
from copy import deepcopy

import numpy as np
import pytest

from skinbus.estimate import TrackState
from tests.files import put
from tests.master.buses_rig import contacts_in
from tests.master.restarting import SCENE, Restarts

pytestmark = pytest.mark.slow


def shown(report):
    """Contacts by identity: number, slot, force (N)."""
    t = report.tracks
    rows = zip(t.identity.tolist(), t.id.tolist(), t.slot.tolist(), t.force, t.state, strict=True)
    return {i: (n, slot, f) for i, n, slot, f, state in rows if state != TrackState.LIFT}


def mean_force(reports):
    """Mean force of each identity."""
    forces = {}
    for report in reports:
        for identity, row in shown(report).items():
            forces.setdefault(identity, []).append(row[2])
    return {i: np.mean(f) for i, f in forces.items()}


class Story:
    """Killed in a press of three fingers, of which two are there when it is started again."""

    def __init__(self, restarts):
        self.restarts = restarts
        restarts.run(2900)
        self.before, _, _ = restarts.run(500)
        self.tables = json.loads(json.dumps(restarts.kill()))
        self.tables |= {"last_identity": 3, "last_id": 3}
        contacts = self.tables["contacts"]
        contacts.append(contacts[0] | {"identity": 3, "id": 3, "slot": 2, "s": 0.045})
        restarts.run(1500)
        self.found = restarts.start(self.tables, 1.5)
        _, _, self.frames = restarts.run(1500)
        self.after, _, _ = restarts.run(500)
        self.last = restarts.master.cycle.tracker.last


@pytest.fixture(scope="module")
def story(tmp_path_factory):
    """With ``zero_at_start``, too: what is pressed at the restart is no zero."""
    scene = put(tmp_path_factory.mktemp("press"), "scene.toml", SCENE)
    return Story(Restarts(scene, level="fit", zero_at_start=True))


def test_killed_in_a_press_it_comes_back_with_the_same_contacts_and_forces(story):
    old, new = shown(story.before[-1]), shown(story.after[-1])
    assert len(old) == 2
    assert {i: row[:2] for i, row in new.items()} == {i: row[:2] for i, row in old.items()}
    assert story.found.n_zeros == 16
    sd = story.restarts.master.cycle.baseline.felt.doubt**0.5
    per_zero = 1e-4 * sd.sum()  # N, if all zeros are off by one sd: a pitch of 10 mm
    was, now = mean_force(story.before), mean_force(story.after)
    for identity in was:
        assert now[identity] == pytest.approx(was[identity], abs=3.0 * per_zero + 0.02)


def test_a_contact_that_ended_while_no_master_ran_is_published_as_it_was_and_lifted(story):
    said = [struct.unpack("<BBh", data[:4]) for can_id, data in contacts_in(story.frames) if can_id == 0x683]
    assert said == [(3, TrackState.COAST << 4, 450)] * 2 + [(3, TrackState.LIFT << 4, 450)]
    assert story.last == (3, 3)


def test_an_old_state_is_not_trusted_and_says_of_which_tactels(story):
    found = story.restarts.start(story.tables, 24 * 3600.0)
    assert found.stale == {0: 16}
    assert not story.restarts.master.cycle.baseline.zeros.any()


def test_another_board_or_calibration_begins_anew(story):
    tables = deepcopy(story.tables)
    (patch,) = tables["patches"].values()
    patch["board"] = "7:16:00000000"
    found = story.restarts.start(tables, 1.0)
    assert (found.n_zeros, len(found.strangers)) == (0, 1)


def test_a_board_that_was_replaced_while_no_master_ran_has_no_zero_of_the_one_before(story):
    tables = deepcopy(story.tables)
    tables["patches"]["/1"]["serial"] = [11] * 16
    story.restarts.start(tables, 1.0)
    story.restarts.device(1).set(0x1018, 4, 12)
    story.restarts.run(3000)
    assert not story.restarts.master.cycle.baseline.felt.known.any()
