"""Recordings: one table read in both directions, then any frame, then python-can as the judge."""

import io
from contextlib import closing
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.can.candump import MAX_FAULTS, CandumpReader, CandumpWriter, format_line, parse_line
from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, RTR, Frame
from skinbus.errors import ConfigError

US = 1000

BY_CANDUMP = Path(__file__).parent / "candump"
"""The same frames on vcan0 and vcan1 as candump of can-utils 2020.11 wrote them with these options."""


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


def frame_of(flags, number, data, us):
    """Return the frame of a kind that a number and bytes give."""
    data = data if flags & FD else data[:8]
    can_id = number if flags & EXTENDED else number & 0x7FF
    return Frame(can_id, bytes(len(data)) if flags & RTR else data, us * US, flags)


KINDS = [0, EXTENDED, RTR, FD | EXTENDED, FD | EXTENDED | BRS, FD | EXTENDED | ESI]
any_frame = st.builds(
    frame_of,
    st.sampled_from(KINDS),
    st.integers(0, 0x1FFFFFFF),
    st.binary(max_size=64),
    st.integers(0, 10**13),
)


@given(st.lists(any_frame, min_size=1, max_size=10))
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


LOGGED = [
    Frame(0x080, b"\x01"),
    Frame(0x181, bytes.fromhex("0011223344556677")),
    Frame(0x182, b""),
    Frame(0x701, b"", 0, RTR),
    Frame(0x701, b"\0", 0, RTR),
    Frame(0x181, b"", 0, FD),
    Frame(0x181, b"\xaa\xbb", 0, FD | BRS),
    Frame(0x12345678, b"\xde\xad\xbe\xef", 0, EXTENDED),
    Frame(0x12345678, b"\x01" * 12, 0, EXTENDED | FD | BRS | ESI),
    Frame(0x80, bytes(8), 0, ERROR),
    Frame(0x123, bytes(8), 0, EXTENDED | RTR),
    Frame(0x123, bytes.fromhex("1122334455667788")),
    Frame(0x7FF, bytes(range(8))),
]
ON_VCAN1 = (2, 9, 10)
TIMES_US = [171891, 212621, 244041, 272439, 298566, 316264, 329746, 343160, 356869, 370459, 384718]
TIMES_US += [398232, 411741]


@pytest.mark.parametrize("name", ["l.log", "L-x.txt"])
def test_logs_of_candump_are_read(name):
    both = name == "l.log"  # the other was on vcan0 only
    wanted = [
        (frame._replace(t_ns=(1_795_263_452_000_000 + t_us) * US), "vcan1" if k in ON_VCAN1 else "vcan0")
        for k, (frame, t_us) in enumerate(zip(LOGGED, TIMES_US, strict=True))
        if both or k not in ON_VCAN1
    ]
    reader = CandumpReader(BY_CANDUMP / name)
    assert list(reader) == wanted
    assert (reader.n_frames, reader.n_strange, reader.is_cut) == (len(wanted), 0, False)


def test_lines_that_are_no_frame_are_counted_and_left_out():
    text = "candump: hello\n(0.0) can0 001#\n(0.0) can0 FFF#\n\n(0.1) can0 002#\nrubbish\n"
    reader = CandumpReader(io.StringIO(text))
    assert [frame.can_id for frame, _ in reader] == [1, 2]
    assert (reader.n_frames, reader.n_strange) == (2, 3)
    assert reader.first_strange.key == "line 1"


def test_frames_that_candump_says_it_dropped_are_counted():
    file = io.StringIO()
    with closing(CandumpWriter(file)) as writer:
        writer.write([Frame(1)])
        writer.dropped(12, 0, 12)
        writer.dropped(1, 0, 13)
    assert file.getvalue().splitlines()[1] == (
        "DROPCOUNT: dropped 12 CAN frames on 'can0' socket (total drops 12)"
    )
    file.seek(0)
    reader = CandumpReader(file)
    assert len(list(reader)) == 1
    assert (reader.n_dropped, reader.n_strange) == (13, 0)


@pytest.mark.parametrize(
    "content", [b"\xff\xfe\x00 junk\n" * 10_000, b"\x00" * 10_000_000, b"name,value\n1,2\n"]
)
def test_file_that_is_no_recording_is_refused_soon_and_not_listed_to_the_end(tmp_path, content):
    path = tmp_path / "bad.log"
    path.write_bytes(content)
    reader = CandumpReader(path)
    with pytest.raises(ConfigError) as caught:
        list(reader)
    assert 1 <= len(caught.value.faults) <= MAX_FAULTS
    assert caught.value.file == str(path)
    assert reader.n_strange <= 1000


@pytest.mark.parametrize("rest", ["(0.1) can0 00", "(0.1) can0 080#", "(0.1) can0 181#0011"])
def test_last_line_without_an_end_is_left_out_even_if_what_is_there_would_be_a_frame(rest):
    reader = CandumpReader(io.StringIO("(0.0) can0 001#00\n" + rest))
    assert [frame.can_id for frame, _ in reader] == [1]
    assert reader.is_cut
    assert reader.n_strange == 0


def test_a_compressed_recording_is_whole_as_soon_as_it_is_written_and_is_read_when_it_was_cut(tmp_path):
    path = tmp_path / "live.log.gz"
    with closing(CandumpWriter(path)) as writer:
        for n in range(1, 50):
            writer.write([Frame(n, bytes(8)), Frame(n)])
            reader = CandumpReader(path)  # as a killed recorder leaves it: the file has no end
            assert len(list(reader)) == 2 * n
            assert reader.is_cut
    whole = path.read_bytes()
    assert len(list(CandumpReader(path))) == 98
    for length in range(30, len(whole), 7):
        path.write_bytes(whole[:length])
        reader = CandumpReader(path)
        try:
            assert len(list(reader)) <= 98
        except ConfigError:
            assert not reader.n_frames
        assert reader.is_cut
    path.write_bytes(b"no gzip")
    with pytest.raises(ConfigError, match="can be read"):
        list(CandumpReader(path))
