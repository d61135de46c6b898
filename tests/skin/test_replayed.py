"""A replayed skin: the cycles of a recording, and what is wrong with it said."""

from contextlib import closing

import pytest

import skinbus
from skinbus.can.candump import CandumpWriter
from skinbus.errors import AddressError
from tests.files import put
from tests.master.rig import Rig
from tests.skin.scenes import write


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A rig whose bus was recorded, and the recording."""
    folder = tmp_path_factory.mktemp("field")
    rig = Rig(write(folder), level="fit")
    with closing(CandumpWriter(folder / "field.log")) as writer:
        rig.wire.tap(lambda frame: writer.write([frame]))
        rig.run(1000)
    return rig, folder / "field.log"


@pytest.mark.slow
def test_the_contacts_of_a_recording_are_made_again(recorded):
    rig, log = recorded
    with skinbus.replay(log, "pad") as skin:
        cycles = list(skin)
    assert len(cycles) >= len(rig.reports) - 1
    published = [len(report.tracks) for report in rig.reports]
    again = [len(cycle.contacts) for cycle in cycles]
    assert again[: len(published)] == published[: len(again)]
    assert max(again) == 1


def test_an_interface_that_is_not_in_the_log_is_refused(recorded, tmp_path):
    lines = recorded[1].read_text().splitlines()
    both = [f"{line}\n{line.replace('can0', 'can1')}\n" for line in lines]
    with pytest.raises(AddressError, match=r"in Python\) which of them"):
        skinbus.replay(put(tmp_path, "two.log", "".join(both)), "pad")
