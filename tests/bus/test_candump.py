"""Recordings: one table read in both directions, then any frame, then python-can as the judge."""

import io

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.bus.candump import CandumpWriter, format_line, parse_line, read_candump
from skinbus.bus.clock import VirtualClock
from skinbus.bus.frame import BRS, ERROR, ESI, EXTENDED, FD, RTR, Frame
from skinbus.bus.wire import Wire
from skinbus.errors import ConfigError
from tests.bus.cores import Talker

US = 1000

TABLE = [
    (Frame(0x123, b"\x00\x11", 1_436_509_052_249_713 * US), "(1436509052.249713) can0 123#0011"),
    (Frame(0x000, b"\x01\x00"), "(0.000000) can0 000#0100"),
    (Frame(0x080, b"", 5 * US), "(0.000005) can0 080#"),
    (Frame(0x7FF, bytes(range(8)), 10**9), "(1.000000) can0 7FF#0001020304050607"),
    (Frame(0x123, b"\xab", 0, EXTENDED), "(0.000000) can0 00000123#AB"),
    (Frame(0x1FFFFFFF, b"", 0, EXTENDED), "(0.000000) can0 1FFFFFFF#"),
    (Frame(0x701, b"", 0, RTR), "(0.000000) can0 701#R"),
    (Frame(0x701, b"\x00", 0, RTR), "(0.000000) can0 701#R1"),
    (Frame(0x12345678, bytes(8), 0, RTR | EXTENDED), "(0.000000) can0 12345678#R8"),
    (Frame(0x181, b"", 0, FD), "(0.000000) can0 181##0"),
    (Frame(0x181, b"\xaa\xbb", 0, FD | BRS), "(0.000000) can0 181##1AABB"),
    (Frame(0x181, b"\x01" * 12, 0, FD | BRS | ESI | EXTENDED), "(0.000000) can0 00000181##3" + "01" * 12),
    (Frame(0x040, bytes(8), 0, ERROR), "(0.000000) can0 20000040#0000000000000000"),
]


@pytest.mark.parametrize(("frame", "line"), TABLE)
def test_frame_is_written_as_its_line(frame, line):
    assert format_line(frame) == line


@pytest.mark.parametrize(("frame", "line"), TABLE)
def test_line_is_read_as_its_frame(frame, line):
    assert parse_line(line) == (frame, "can0")
    assert parse_line(line + "\n") == (frame, "can0")


times = st.integers(0, 10**13).map(lambda us: us * US)
any_frame = st.one_of(
    st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8), times, st.just(0), st.just(0)),
    st.builds(Frame, st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), times, st.just(EXTENDED), st.just(0)),
    st.builds(Frame, st.integers(0, 0x7FF), st.integers(0, 8).map(bytes), times, st.just(RTR), st.just(0)),
    st.builds(
        Frame,
        st.integers(0, 0x1FFFFFFF),
        st.binary(max_size=64),
        times,
        st.sampled_from([0, BRS, ESI]).map(lambda more: FD | EXTENDED | more),
        st.just(0),
    ),
    st.builds(Frame, st.integers(0, 0x1FFFFFFF), st.just(bytes(8)), times, st.just(ERROR), st.just(0)),
)


@given(st.lists(any_frame, max_size=20))
def test_what_is_written_is_read_again(frames):
    frames.sort(key=lambda frame: frame.t_ns)
    file = io.StringIO()
    with CandumpWriter(file, channel="vcan3") as writer:
        for frame in frames:
            writer(frame)
    assert writer.n_frames == len(frames)
    file.seek(0)
    assert list(read_candump(file)) == frames


@given(st.lists(any_frame.filter(lambda frame: not frame.flags & ERROR), min_size=1, max_size=10))
def test_python_can_reads_what_is_written(frames):
    text = "".join(format_line(frame) + "\n" for frame in frames)
    for frame, message in zip(frames, can.CanutilsLogReader(io.StringIO(text)), strict=True):
        assert message.arbitration_id == frame.can_id
        assert message.is_extended_id == bool(frame.flags & EXTENDED)
        assert message.is_remote_frame == bool(frame.flags & RTR)
        assert message.is_fd == bool(frame.flags & FD)
        assert message.dlc == len(frame.data)
        assert message.timestamp == pytest.approx(frame.t_ns * 1e-9, abs=1e-6)
        if not frame.flags & RTR:
            assert message.data == frame.data


def test_lines_of_python_can_are_read():
    file = io.StringIO()
    writer = can.CanutilsLogWriter(file)
    writer.on_message_received(
        can.Message(arbitration_id=0x181, is_extended_id=False, data=[1, 2], timestamp=1.5)
    )
    file.seek(0)
    assert list(read_candump(file)) == [Frame(0x181, b"\x01\x02", 1_500_000_000)]


BAD_LINES = [
    "123#00",
    "(1.0) can0 123",
    "(1.0) can0 12#00",
    "(1.0) can0 123#0",
    "(1.0) can0 FFF#00",
    "(1.0) can0 123#00112233445566778899",
    "(1.0) can0 123#R9",
    "(1.0) can0 123##",
    "(x) can0 123#00",
    "(1.0) can0 123#00 junk",
]


@pytest.mark.parametrize("line", BAD_LINES)
def test_bad_line_is_refused(line):
    with pytest.raises(ValueError, match="wanted"):
        parse_line(line)


def test_file_is_refused_with_all_its_faults(tmp_path):
    path = tmp_path / "bad.log"
    path.write_text("(0.0) can0 001#\n(0.0) can0 FFF#\n\n(0.1) can0 002#\nrubbish\n")
    frames = read_candump(path)
    assert next(frames).can_id == 1
    with pytest.raises(ConfigError) as caught:
        next(frames)
    assert [fault.key for fault in caught.value.faults] == ["line 2", "line 5"]
    assert caught.value.file == str(path)


def test_file_that_is_no_recording_is_not_listed_to_the_end(tmp_path):
    path = tmp_path / "bad.log"
    path.write_bytes(b"\xff\xfe\x00 junk\n" * 1000)
    with pytest.raises(ConfigError) as caught:
        list(read_candump(path))
    assert len(caught.value.faults) == 20


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        list(read_candump(tmp_path / "none.log"))


def test_last_line_cut_short_ends_the_recording(tmp_path):
    path = tmp_path / "cut.log"
    path.write_text("(0.0) can0 001#00\n(0.1) can0 00")
    assert [frame.can_id for frame in read_candump(path)] == [1]


def test_one_channel_of_several_can_be_read():
    text = "(0.0) can0 001#\n(0.0) can1 002#\n(0.0) can0 003#\n"
    assert [f.can_id for f in read_candump(io.StringIO(text), channel="can0")] == [1, 3]
    assert [f.can_id for f in read_candump(io.StringIO(text))] == [1, 2, 3]


def test_times_never_go_back_in_a_recording():
    file = io.StringIO()
    writer = CandumpWriter(file)
    for t_ns in (5_000, 3_000, 7_000):
        writer(Frame(1, b"", t_ns))
    assert [line.split()[0] for line in file.getvalue().splitlines()] == [
        "(0.000005)",
        "(0.000005)",
        "(0.000007)",
    ]


def test_recording_holds_unix_time_when_the_clock_knows_it():
    class Clock(VirtualClock):
        def wall_ns(self, t_ns):
            return t_ns + 1_700_000_000 * 10**9

    file = io.StringIO()
    CandumpWriter(file, clock=Clock())(Frame(1, b"", 2_000))
    assert file.getvalue().startswith("(1700000000.000002) can0 001#")


def test_recorded_frames_reach_the_file_within_a_second_of_bus_time(tmp_path):
    path = tmp_path / "live.log"
    writer = CandumpWriter(path)
    for t_s in (0, 1, 2):
        writer(Frame(t_s, b"", t_s * 10**9))
    seen = len(path.read_text().splitlines())
    writer.close()
    writer.close()
    assert seen >= 2
    assert len(path.read_text().splitlines()) == 3


def test_wire_is_recorded_by_tapping_it():
    file = io.StringIO()
    wire = Wire()
    wire.attach(Talker([(0, Frame(0x80, b"\x01")), (20_000_000, Frame(0x80, b"\x02"))]))
    writer = CandumpWriter(file)
    wire.tap(writer)
    wire.run(10**9)
    file.seek(0)
    assert [(f.can_id, f.data) for f in read_candump(file)] == [(0x80, b"\x01"), (0x80, b"\x02")]
