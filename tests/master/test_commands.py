"""The zero command: what a client writes when a skin feels a touch that is none."""

import struct

import numpy as np
import pytest

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import COMMAND, PATCH_COMMAND, PATCH_SUSPECT, ZERO, index_of
from tests.master.rig import MS, Rig
from tests.master.sdo_reads import number
from tests.master.sdo_reads import write as write_bytes

OD = load_eds("skin-master", 127)
ALL, _ = index_of(OD, COMMAND)
ONE, _ = index_of(OD, PATCH_COMMAND)
SUSPECT, _ = index_of(OD, PATCH_SUSPECT)
FAR_OFF = 3000
"""Counts: three times the touch threshold."""


def write(master, index, sub, value):
    return write_bytes(master.device, index, sub, value.to_bytes(4, "little"))


@pytest.fixture
def offset():
    """A forearm on which patches 3 and 7 read far off zero ever since power came: their offsets are wrong."""
    forearm = Rig("forearm", level="kmeans")
    forearm.patches.added_counts = dict.fromkeys((3, 7), FAR_OFF)
    forearm.run(800)
    return forearm


def contacts_of(rig, ms=100):
    """Patches that feel contacts, by node-ID, in the last of some cycles."""
    report = rig.run(ms)[0][-1]
    return set(rig.master.arm.node_id[report.contacts.patch].tolist())


@pytest.mark.slow
def test_offset_looks_like_a_touch_until_its_patch_is_zeroed(offset):
    assert {3, 7} <= contacts_of(offset)
    assert number(offset.master, SUSPECT, 3) == 16
    # a wrong word, or a patch that is none, changes nothing
    zeros = offset.master.cycle.baseline.zeros
    assert write(offset.master, ALL, 0, ZERO + 1).abort == 0x08000020
    assert write(offset.master, ONE, 3, 1).abort == 0x08000020
    assert write(offset.master, ONE, 60, ZERO).abort == 0x08000021
    assert (offset.master.cycle.baseline.zeros == zeros).all()
    assert write(offset.master, ONE, 3, ZERO).abort is None
    assert contacts_of(offset) & {3, 7} == {7}
    offset.run(500)
    assert [number(offset.master, SUSPECT, node_id) for node_id in (3, 7)] == [0, 16]


@pytest.mark.slow
def test_zero_while_touched_lifts_what_touched_and_says_so(offset):
    def ask(index, sub):  # an expedited download
        offset.say(Frame(0x600 + 127, struct.pack("<BHBI", 0x23, index, sub, ZERO)))
        _, events, frames = offset.run(200)
        states = {frame.data[1] >> 4 for frame in frames if 0x681 <= frame.can_id <= 0x690}
        return [(e.node_id, e.count) for e in events if e.kind == EventKind.ZEROED], states

    told, states = ask(ONE, 3)
    assert told == [(3, 16)]
    assert 3 in states, "clients see the contacts lifted"
    n_touched = int(offset.master.cycle.baseline.touched.sum())
    assert n_touched >= 16, "patch 7 is touched still"
    assert ask(ALL, 0)[0] == [(0, n_touched)]


PRESS = np.array([500, 1200, 500, 0, 1200, 4000, 1200, 0, 500, 1200, 500, 0, 0, 0, 0, 0], np.int32)
"""A finger on tactel 5 of four by four, and what it gives those around."""


@pytest.mark.parametrize("zero_at_start", [False, True])
def test_what_presses_from_the_first_reading_on_is_zero_only_if_so_asked(zero_at_start):
    cycle = Rig("press", zero_at_start=zero_at_start).master.cycle
    counts = PRESS
    n = [len(cycle.run(20 * MS * k, counts, np.ones(1, np.bool_))[0]) for k in range(3)]
    assert not any(n) if zero_at_start else all(n)
    assert len(cycle.run(60 * MS, 2 * counts, np.ones(1, np.bool_))[0])
