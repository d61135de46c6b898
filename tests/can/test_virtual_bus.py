"""The in-process bus does what a CAN wire does."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.can.frame import EXTENDED, RTR, Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.can.wire_bits import frame_bits
from tests.bus.cores import ERROR_BITS, Talker, bare, destroy_one

BIT_NS = 1000  # at 1 Mbit/s
SECOND_NS = 1_000_000_000


def test_frame_is_heard_at_the_end_of_its_last_bit_by_all_others():
    frame = Frame(0x181, b"\x12\x34")
    sender, a, b = Talker([(5000, frame)]), Talker(), Talker()
    wire = VirtualBus()
    for core in (sender, a, b):
        wire.attach(core)
    wire.run(SECOND_NS)
    end_ns = 5000 + (frame_bits(frame) - 3) * BIT_NS
    assert a.heard == b.heard == [frame._replace(t_ns=end_ns)]
    assert sender.heard == []
    assert a.steps == [0, end_ns]


ARBITRATION_ORDER = [
    Frame(0x000, b""),
    Frame(0x0FF, b""),
    Frame(0x100, b"", flags=0),
    Frame(0x100, b"", flags=RTR),
    Frame(0x100 << 18, b"", flags=EXTENDED),
    Frame(0x100 << 18, b"", flags=EXTENDED | RTR),
    Frame(0x100 << 18 | 1, b"", flags=EXTENDED),
    Frame(0x101, b""),
    Frame(0x7FF, b""),
    Frame(0x1FFFFFFF, b"", flags=EXTENDED),
]


@given(st.permutations(ARBITRATION_ORDER), st.booleans())
def test_lowest_wins_data_before_remote_and_standard_before_extended(frames, same_port):
    # One frame occupies the bus while the others queue up, on one port or on a port each.
    wire = VirtualBus()
    listener = Talker()
    wire.attach(Talker([(0, Frame(0x700))]))
    if same_port:
        wire.attach(Talker([(10, frame) for frame in frames]))
    else:
        for frame in frames:
            wire.attach(Talker([(10, frame)]))
    wire.attach(listener)
    wire.run(SECOND_NS)
    assert bare(listener.heard[1:]) == bare(ARBITRATION_ORDER)


@given(
    st.lists(st.tuples(st.integers(0, 3), st.sampled_from([0x10, 0x20]), st.binary(max_size=2)), max_size=20)
)
def test_frames_of_one_port_and_identifier_stay_in_order(items):
    sender = Talker([(t_ns, Frame(can_id, data)) for t_ns, can_id, data in items])
    planned = [frame for _, frame in sender.plan]
    listener = Talker()
    wire = VirtualBus()
    wire.attach(sender)
    wire.attach(listener)
    wire.run(SECOND_NS)
    for can_id in (0x10, 0x20):
        sent = [frame.data for frame in planned if frame.can_id == can_id]
        assert [frame.data for frame in listener.heard if frame.can_id == can_id] == sent


def test_only_data_frames_of_its_11_bit_identifiers_reach_a_core_that_names_them():
    frames = [Frame(0x701, b"\x05"), Frame(0x701, bytes(1), flags=RTR), Frame(0x900, flags=EXTENDED | RTR)]
    frames.append(Frame(0x701, flags=EXTENDED))
    picky, all_hearing = Talker(cob_ids=frozenset({0x701, 0x900})), Talker()
    wire = VirtualBus()
    for core in (Talker([(0, frame) for frame in frames]), picky, all_hearing):
        wire.attach(core)
    wire.run(SECOND_NS)
    assert [(frame.can_id, frame.flags) for frame in picky.heard] == [(0x701, 0)]
    assert len(all_hearing.heard) == 4


@pytest.mark.parametrize("bitrate", [0, -1, 2_000_000])
def test_impossible_bit_rate_is_refused(bitrate):
    with pytest.raises(ValueError, match="bitrate"):
        VirtualBus(bitrate)


def test_detached_port_neither_hears_nor_speaks_until_it_is_plugged_in_again():
    speaker = Talker([(t_ns, Frame(0x10)) for t_ns in (0, SECOND_NS, 3 * SECOND_NS)])
    other = Talker([(2 * SECOND_NS, Frame(0x20)), (4 * SECOND_NS, Frame(0x20))])
    wire = VirtualBus()
    port = wire.attach(speaker)
    wire.attach(other)
    wire.run(SECOND_NS // 2)
    wire.detach(port)
    wire.run(5 * SECOND_NS // 2)
    assert len(other.heard) == 1
    assert speaker.heard == []
    wire.restart(port)
    wire.run(5 * SECOND_NS)
    assert len(other.heard) == 3
    assert len(speaker.heard) == 1


def collide(*bodies, n=1):
    """Ports that send identifier 0x181 with the given data at the same instants, n times."""
    listener = Talker()
    wire = VirtualBus()
    ports = [wire.attach(Talker([(k * SECOND_NS, Frame(0x181, body)) for k in range(n)])) for body in bodies]
    wire.attach(listener)
    wire.run(n * SECOND_NS)
    return ports, listener.heard


def test_equal_frames_sent_at_once_are_one_frame():
    ports, heard = collide(b"\x01\x02", b"\x01\x02")
    assert bare(heard) == [(0x181, b"\x01\x02", 0)]
    assert [port.queued for port in ports] == [0, 0]
    assert [port.error_counter for port in ports] == [0, 0]


def test_different_frames_of_one_identifier_destroy_each_other_until_one_port_is_passive():
    ports, heard = collide(b"\x01", b"\x02")
    # 16 errors of 8 make both error passive; then the dominant one (0x01 < 0x02) gets through.
    assert bare(heard) == [(0x181, b"\x01", 0), (0x181, b"\x02", 0)]
    assert [port.error_counter for port in ports] == [127, 135]
    assert heard[0].t_ns > 16 * (19 + 7 + 23) * BIT_NS  # header, equal bits and error frame of each


def test_frames_of_different_length_collide_in_the_length_field():
    _, heard = collide(b"\x00\x00", b"\xff")
    assert [frame.data for frame in heard] == [b"\xff", b"\x00\x00"]


def test_frame_that_a_bit_error_destroys_is_repeated_after_what_wins_meanwhile():
    frame, urgent, listener, wire = Frame(0x181, b"\x01"), Frame(0x080), Talker(), VirtualBus()
    port, *_ = [wire.attach(core) for core in (Talker([(0, frame)]), Talker([(10, urgent)]), listener)]
    destroy_one(wire, frame.can_id)
    wire.run(SECOND_NS)
    assert bare(listener.heard) == bare([urgent, frame])
    bits = 2 * frame_bits(frame) + ERROR_BITS + frame_bits(urgent)
    assert listener.heard[1].t_ns == BIT_NS * (bits - 3)
    assert port.error_counter == 8 - 1


def test_port_in_bus_off_is_silent_and_deaf_until_restarted():
    rounds = [k * SECOND_NS for k in range(40)]
    winner = Talker([(t_ns, Frame(0x181, b"\x01")) for t_ns in rounds])
    loser = Talker(
        [(t_ns, Frame(0x181, b"\x02")) for t_ns in rounds]
        + [(50 * SECOND_NS, Frame(0x300)), (70 * SECOND_NS, Frame(0x301))]
    )
    other = Talker([(55 * SECOND_NS, Frame(0x10)), (75 * SECOND_NS, Frame(0x11))])
    wire = VirtualBus()
    wire.attach(winner)
    port = wire.attach(loser)
    wire.attach(other)
    wire.run(60 * SECOND_NS)
    assert port.bus_off
    wire.restart(port)
    wire.run(80 * SECOND_NS)
    assert {0x300, 0x301} & {frame.can_id for frame in other.heard} == {0x301}
    assert {0x10, 0x11} & {frame.can_id for frame in loser.heard} == {0x11}
