"""A recording through the master that follows: the contacts that were published, from wherever it begins."""

import struct
from operator import itemgetter

import numpy as np
import pytest

from skinbus.master.replay import Replay
from tests.master.buses_rig import ON_LEFT, ON_RIGHT, ON_SEAM, BusesRig, contacts_in, write_scene
from tests.master.rig import MS, Rig

pytestmark = pytest.mark.slow

S = 1000 * MS


def recorded(frames):
    """Frames as a file has them: whole microseconds."""
    return [frame._replace(t_ns=frame.t_ns // 1000 * 1000) for frame in frames]


def sent_by(replay):
    """The frames that its master sends from now on."""
    sent, step = [], replay.master.step

    def tapped(*arguments):
        answer = step(*arguments)
        sent.extend(answer.frames)
        return answer

    replay.master.step = tapped
    return sent


class Again:
    """A recording gone through: the cycles, and the contacts that were sent."""

    def __init__(self, arm, frames, **settings):
        self.reports = []
        self.replay = Replay(arm, on_cycle=self.reports.append, **settings)
        self.sent = sent_by(self.replay)
        for frame in frames:
            self.replay.take(frame)
        self.replay.end()
        self.contacts = contacts_in(self.sent)

    @property
    def counters(self):
        return self.replay.master.gather.counters


@pytest.fixture(scope="module")
def pad():
    rig = Rig("pad", level="fit")
    rig.run(2500)
    return rig


@pytest.mark.parametrize("scene", ["forearm", "noisy-bus", "dying-patch"])
def test_a_recording_gives_the_very_contacts_that_the_master_published(scene):
    # Not "everything", where ghosts come and go: which track one continues may hang on the time between two
    # cycles, and a recording has that of the SYNCs on the wire.
    # kmeans: a fit weighs by the age of zeros, which a SYNC's time on the wire changes in the last bit.
    rig = Rig(scene, level="kmeans")
    _, _, frames = rig.run(1500)
    published = contacts_in(frames)
    assert published
    again = Again(rig.scene.arm, recorded(frames), level="kmeans")
    assert again.counters == rig.master.gather.counters
    # By identifier: those of a cycle that ended at its deadline wait for the bus still when those of the
    # next come, and arbitration mixes them.
    assert sorted(again.contacts, key=itemgetter(0)) == sorted(published, key=itemgetter(0))


def test_a_recording_that_begins_in_the_middle_gives_the_contacts_from_there_on(pad):
    frames = [frame for frame in recorded(pad.frames) if frame.t_ns > 1000 * MS]
    again = Again(pad.scene.arm, frames, level="fit")
    last = contacts_in(frames)[-100:]
    assert len(last) == 100
    places = [[struct.unpack("<hhH", data[2:]) for _, data in each] for each in (again.contacts[-100:], last)]
    # zeros and noise are the means of other readings: by the last digit, 0.1 mm and 0.01 N
    assert np.abs(np.subtract(*places)).max() <= 1
    assert again.counters.missing == 0


def test_contacts_on_two_buses_are_made_again_from_one_recording(tmp_path):
    rig = BusesRig(write_scene(tmp_path, [ON_LEFT, ON_RIGHT, ON_SEAM]))
    rig.run(1000)
    both = [frame._replace(bus=bus) for bus, frames in enumerate(rig.frames) for frame in frames]
    both.sort(key=lambda frame: frame.t_ns)
    sent = Again(rig.scene.arm, recorded(both)).sent
    for bus, frames in enumerate(rig.frames):
        assert contacts_in([frame for frame in sent if frame.bus == bus]) == contacts_in(frames)


def test_time_never_goes_back_and_a_clock_that_was_set_costs_no_contacts(pad):
    frames = recorded(pad.frames)
    half = len(frames) // 2
    for jump_ns in (3600 * S, -3600 * S):
        moved = frames[:half] + [f._replace(t_ns=f.t_ns + jump_ns) for f in frames[half:]]
        again = Again(pad.scene.arm, moved, level="fit")
        assert again.replay.timeline.n_jumps == 1
        last = again.reports[-1]
        assert last.n_fresh == 1
        assert len(last.contacts) == 1
        times = [report.t_ns for report in again.reports]
        assert times == sorted(times)
