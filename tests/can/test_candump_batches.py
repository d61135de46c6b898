"""Recordings as columns: whatever the text is, the frames and the counts are those of the reader of lines."""

import gzip

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.can import candump_batches
from skinbus.can.candump import LONGEST_LINE, CandumpReader, format_line
from skinbus.can.candump_batches import CandumpBatches
from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, RTR, Frame
from skinbus.errors import ConfigError

SOME = [
    Frame(0x123, b"\x00\x11", 1_436_509_052_249_713_000),
    Frame(0x080, b"", 5000),
    Frame(0x7FF, bytes(range(8)), 10**9),
    Frame(0x1FFFFFFF, b"\xab", 0, EXTENDED),
    Frame(0x701, b"\0\0", 0, RTR),
    Frame(0x181, bytes(64), 0, FD | BRS | ESI),
    Frame(0x18100, bytes(12), 0, FD | EXTENDED),
    Frame(0x4, bytes(8), 0, ERROR),
]
STRANGE = [
    "",
    "   ",
    "garbage \x7f \xff",
    "(1.0) can0 FFF#00",
    "(1.0) can0 123#0",
    "(1.0) can0 123#000102030405060708",
    "(1.0) can0 123##G00",
    "(12345678901.0) can0 123#",
    "(1.1234567890) can0 123#",
    "(1.1) can0  123#",
    " (1.000001)  can1  5A1   [8]  00 01 02 03 04 05 06 07",
    "(1.000001) can0 123#00 R",
    "(1.5) can0 abc#aB",
    "(1.5) a-name-longer-than-16-bytes 123#00",
    "(1.5) \u20ac 123#00",
    "# mark 3 (1.500000)",
    "DROPCOUNT: dropped 2 CAN frames on 'can0' socket (total drops 2)",
    "(1.000000) can0 123#00" + " " * LONGEST_LINE,
    "x" * (2 * LONGEST_LINE + 7),
]
LINES = st.one_of(
    st.builds(
        lambda frame, channel: format_line(frame, channel=channel),
        st.sampled_from(SOME),
        st.sampled_from(["can0", "can1", "vcan0", "can"]),
    ),
    st.sampled_from(STRANGE),
    st.text(st.characters(codec="utf-8", exclude_characters="\n\r"), max_size=40),
)


def by_lines(path):
    reader = CandumpReader(path)
    frames = []
    try:
        frames += reader
    except ConfigError as error:
        return reader, str(error).splitlines()[0]
    return reader, frames


def by_batches(path):
    reader = CandumpBatches(path)
    frames = []
    try:
        for batch in reader.batches():
            frames += [(frame._replace(bus=0), reader.channels[frame.bus]) for frame in batch]
    except ConfigError as error:
        return reader, str(error).splitlines()[0]
    return reader, frames


def check_alike(path):
    (one, frames), (other, same) = by_lines(path), by_batches(path)
    assert same == frames
    assert (other.n_frames, other.n_strange, other.n_dropped) == (one.n_frames, one.n_strange, one.n_dropped)
    assert (other.is_cut, other.marks) == (one.is_cut, one.marks)
    return frames


@given(
    st.lists(LINES, max_size=30),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.booleans(),
    st.sampled_from([7, 64, 1 << 22]),
)
def test_any_text_gives_what_the_reader_of_lines_gives(tmp_path_factory, lines, end, is_whole, block):
    path = tmp_path_factory.mktemp("any") / "some.log"
    text = end.join(lines) + (end if is_whole else "")
    path.write_bytes(text.encode())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candump_batches, "BLOCK", block)
        check_alike(path)


def test_batches_are_bounded_and_lose_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(candump_batches, "CAPACITY", 16)
    path = tmp_path / "many.log"
    path.write_text(
        "".join(format_line(Frame(k % 2048, bytes([k % 256]), k * 1000)) + "\n" for k in range(1000))
    )
    sizes = [batch.n for batch in CandumpBatches(path).batches()]
    assert max(sizes) == 16
    assert len(check_alike(path)) == 1000


def test_a_compressed_recording_of_a_killed_recorder_gives_what_is_there(tmp_path):
    path = tmp_path / "cut.log.gz"
    text = "".join(format_line(Frame(k % 2048, bytes([k % 256]), k * 1000)) + "\n" for k in range(5000))
    path.write_bytes(gzip.compress(text.encode())[:-900])
    reader, frames = by_batches(path)
    assert reader.is_cut
    assert frames == by_lines(path)[1][: len(frames)]
    assert len(frames) > 3000


def test_times_that_do_not_fit_64_bits_of_nanoseconds_are_counted(tmp_path):
    path = tmp_path / "late.log"
    path.write_text("(9999999999.0) can0 123#\n(9223372035.999999999) can0 123#\n")
    reader, frames = by_batches(path)
    assert [frame.t_ns for frame, _ in frames] == [9_223_372_035_999_999_999]
    assert reader.n_strange == 1


def test_a_file_that_is_none_is_refused_as_by_the_reader_of_lines(tmp_path):
    for name, content in (("empty", ""), ("other", "no frame\n" * 3000)):
        path = tmp_path / name
        path.write_text(content)
        check_alike(path)
    with pytest.raises(ConfigError, match="can be read"):
        next(CandumpBatches(tmp_path / "absent").batches())
