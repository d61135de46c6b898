"""The bounds of the schedule: against the published example, and against the wire in the critical instant."""

import pytest

from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.can.wire_bits import frame_bits
from skinbus.config.system import load_arm, ods_of
from skinbus.objects.eds import load_eds
from skinbus.planning.schedule import (
    ErrorModel,
    Message,
    Release,
    cycle_times,
    response_times,
)
from skinbus.planning.traffic import traffic
from tests.bus.cores import Talker

MS = 1_000_000


def test_published_example_has_its_published_times():
    """Davis et al. 2007, table 3: the second instance of C is the late one, which older analyses missed."""
    bits, rate = 125, 125_000  # 1 ms
    messages = [
        Message(name="A", cob_id=1, bits=bits, period_ns=2_500_000),
        Message(name="B", cob_id=2, bits=bits, period_ns=3_500_000),
        Message(name="C", cob_id=3, bits=bits, period_ns=3_500_000),
    ]
    assert response_times(messages, rate) == {1: 2 * MS, 2: 3 * MS, 3: 3_500_000}


def test_response_time_of_patches_delays_every_reading_by_at_least_itself():
    messages = traffic(ods_of(load_arm("pad")), rate_hz=100).messages
    at_once = cycle_times(messages, 1_000_000)
    later = cycle_times(messages, 1_000_000, response_ns=200_000)
    for m in messages:
        if m.release is Release.READING:
            assert later[m.cob_id] >= at_once[m.cob_id] + 200_000


def longest(can_id, length):
    """A frame with as many stuff bits as simple patterns give: groups of five, then four equal bits."""
    candidates = []
    for shift in range(10):
        bits = ("00000" + "11110000" * 10)[shift : shift + 8 * length]
        for text in (bits, bits.translate(str.maketrans("01", "10"))):
            data = int(text, 2).to_bytes(length, "big") if length else b""
            candidates.append(Frame(can_id, data))
    return max(candidates, key=frame_bits)


@pytest.mark.parametrize("name", ["pad", "forearm", "arm"])
def test_wire_in_the_critical_instant_stays_below_the_bound_and_near_it(name):
    arm = load_arm(name)
    rate, bitrate = arm.bus.rate_hz, arm.bus.bitrate
    messages = traffic(ods_of(arm), rate_hz=rate, contacts=0).messages
    bounds = cycle_times(messages, bitrate)

    # One bit before the SYNC a long frame of low priority has begun; NMT and EMCY come along with the SYNC.
    sync_ns = 1_000_000
    bit_ns = 1_000_000_000 // bitrate
    blocker = Talker([(sync_ns - bit_ns, longest(0x67F, 8))])
    lengths = {"NMT": 2, "SYNC": 1, "EMCY 1": 8}
    first = [(sync_ns, longest(m.cob_id, lengths[m.name])) for m in messages if m.name in lengths]
    readings = [longest(m.cob_id, 8) for m in messages if m.release is Release.READING]

    wire = VirtualBus(bitrate)
    ends = {}
    wire.tap(lambda frame: ends.setdefault(frame.can_id, frame.t_ns))
    for core in (blocker, Talker(first), Talker((), frozenset({0x80}), readings)):
        wire.attach(core)
    wire.run(sync_ns + 20 * MS)

    cycle = [m for m in messages if m.release in (Release.READING, Release.SYNC)]
    measured = {m.cob_id: ends[m.cob_id] - sync_ns for m in cycle}
    assert all(measured[m.cob_id] <= bounds[m.cob_id] for m in cycle)
    last = max(m.cob_id for m in cycle)
    assert measured[last] >= 0.9 * bounds[last], (measured[last], bounds[last])


def test_event_driven_readings_without_inhibit_time_are_named():
    od = load_eds("skin-patch", 3, settings=(("0x1800:02", 255), ("0x1801:02", 255), ("0x1801:03", 100)))
    found = traffic([od], rate_hz=50)
    assert found.unpaced == ("patch 3 TPDO 1",)
    second = next(m for m in found.messages if m.name == "patch 3 TPDO 2")
    assert second.period_ns == 10 * MS
    assert second.release is Release.SPORADIC


def test_errors_cost_an_error_frame_and_a_retransmission_each():
    """By hand: one message of 135 bits alone at 1 Mbit/s, a burst of two errors, none beyond."""
    (m,) = [Message(name="m", cob_id=0x181, bits=135, period_ns=20_000_000)]
    errors = ErrorModel(burst=2)
    assert response_times([m], 1_000_000, errors) == {0x181: 135_000 + 2 * (31_000 + 135_000)}
    assert response_times([m], 1_000_000) == {0x181: 135_000}
    # one error every 100 us leaves no time for a frame of 135
    assert response_times([m], 1_000_000, ErrorModel(per_s=10_000.0)) == {0x181: None}
