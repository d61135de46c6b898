"""A recording played on a bus is the recording again."""

import io

import pytest

from skinbus.bus.candump import CandumpWriter, read_candump
from skinbus.bus.core import NEVER, STOP
from skinbus.bus.frame import ERROR, Frame
from skinbus.bus.recording import Replay
from skinbus.bus.wire import Wire
from skinbus.model.classic import worst_case_bits
from tests.bus.cores import Talker

MS = 1_000_000
FRAMES = [Frame(0x80, b"\x01", 50 * MS), Frame(0x181, b"\xaa", 50 * MS), Frame(0x80, b"\x02", 70 * MS)]


def test_frames_come_with_the_pauses_of_the_recording():
    replay = Replay(FRAMES)
    assert replay.step(1_000 * MS, ())[::2] == (FRAMES[:2], 1_020 * MS)
    assert replay.step(1_019 * MS, ())[::2] == ([], 1_020 * MS)
    last = replay.step(1_020 * MS, ())
    assert last.frames == FRAMES[2:]
    assert last.wake_ns == NEVER
    assert [event.kind for event in last.events] == [STOP]
    assert replay.step(2_000 * MS, ()).events == ()
    assert replay.n_played == 3


def test_late_call_sends_all_that_is_due_in_order():
    replay = Replay(FRAMES)
    replay.step(0, ())
    assert replay.step(500 * MS, ()).frames == FRAMES[2:]


def test_speed_divides_the_pauses():
    assert Replay(FRAMES, speed=2.0).step(0, ()).wake_ns == 10 * MS


@pytest.mark.parametrize("speed", [0, -1, float("nan")])
def test_impossible_speed_is_refused(speed):
    with pytest.raises(ValueError, match="speed"):
        Replay(FRAMES, speed=speed)


def test_error_frames_are_left_out_and_an_empty_recording_ends_at_once():
    step = Replay([Frame(0x40, bytes(8), 0, ERROR)]).step(0, ())
    assert list(step.frames) == []
    assert [event.kind for event in step.events] == [STOP]


def test_replay_is_recorded_as_what_was_played():
    file = io.StringIO()
    wire = Wire()
    wire.attach(Replay(FRAMES))
    wire.attach(Talker())
    wire.tap(CandumpWriter(file))
    wire.run(10**9)
    file.seek(0)
    again = list(read_candump(file))
    assert [frame[:2] for frame in again] == [frame[:2] for frame in FRAMES]
    # A recording holds the ends of frames, here they are beginnings: pauses change by a frame at most.
    pause_ns = again[2].t_ns - again[0].t_ns
    assert abs(pause_ns - 20 * MS) <= worst_case_bits(8) * 1000
