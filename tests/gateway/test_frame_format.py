"""Formats of skins that are not CANopen, byte by byte as their sources print them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from skinbus.can.frame import EXTENDED, RTR, Frame
from skinbus.errors import ArgumentError, ConfigError
from skinbus.gateway.frame_format import FORMATS, format_names, load_format
from skinbus.gateway.receiver import Receiver
from tests.files import put
from tests.gateway.doubles import frame_of


def uspa(rows, columns):
    """Return the sample of a uSPa whose first frame is the example of its users."""
    raw = [0x9312 + 0x111 * k for k in range(rows * columns)]
    frames = [f"{k // columns:X}{k % columns:X}4#937E317E15{z:04X}0F" for k, z in enumerate(raw)]
    return f"xela-uspa{rows}{columns}", "4", frames, raw


# format, address, frames of one sample, raw reading of each tactel
SAMPLES = [
    (
        "icub-mtb4",
        "3.5",
        ["435#40F0EFEEEDECEBAA", "435#C0EAE9E8AAE70000"],
        [0xF0, 0xEF, 0xEE, 0xED, 0xEC, 0xEB, 0xEA, 0xE9, 0xE8, 0xE7],
    ),
    (
        "xela-uskin",
        "2",
        [f"72{t:X}#00000000000{t:X}{t:X}0" for t in range(16)],
        [t << 8 | t << 4 for t in range(16)],
    ),
    *(uspa(*shape) for shape in ((2, 2), (4, 4), (4, 6))),
    (
        "cyskin-finger",
        "",
        ["405#0001000200030004", "407#0005000600070008", "409#0009000A000B000C", "40B#000D000E000F0010"],
        list(range(1, 17)),
    ),
    (
        "linkerhand",
        "7.2",
        [f"027#B2{row:X}0" + "".join(f"{6 * row + k:02X}" for k in range(6)) for row in range(8)],
        list(range(48)),
    ),
]
COMMANDS = [
    ("icub-mtb4", "start", ["2.0", "2.1", "4.0"], [
        "202#4D0032F0", "204#4D0032F0", "202#50000F02010022", "204#50000F02010022", "202#0700", "204#0700",
    ]),
    ("icub-mtb4", "stop", ["2.0"], ["202#0701"]),
    ("xela-uskin", "start", ["15"], ["20F#0700"]),
    ("linkerhand", "poll", ["7.1", "8.5"], ["027#B1C6", "028#B5C6"]),
]  # fmt: skip


def frame(text, t_ns=0, flags=0):
    can_id, data = text.split("#")
    return Frame(int(can_id, 16), bytes.fromhex(data), t_ns, flags)


def text(can_id, data):
    return f"{can_id:03X}#{data.hex().upper()}"


@pytest.mark.parametrize(("name", "address", "frames", "raw"), SAMPLES)
def test_frames_are_read_and_sent_as_their_source_says(name, address, frames, raw):
    found = load_format(name)
    receiver = Receiver(found, [address])
    for line in frames:
        receiver.take(frame(line, 7))
    sample = receiver.newest(7)
    assert_array_equal(sample.counts, found.counts(np.array(raw)))
    assert sample.t_ns == [7]
    assert sample.healthy.all()
    assert receiver.faults == [""]
    assert not receiver.n_foreign
    for part, line in zip(found.parts(address), frames, strict=True):
        (can_id, sent), seen = frame_of(part, raw, found.type), frame(line)
        start = part.table.byte
        assert (can_id, sent[: len(part.data)]) == (seen.can_id, seen.data[: len(part.data)])
        assert sent[start:] == seen.data[start : part.length]


@pytest.mark.parametrize(("name", "kind", "addresses", "frames"), COMMANDS)
def test_commands_are_those_of_the_source(name, kind, addresses, frames):
    found = load_format(name)
    assert [text(*each) for each in found.commands(getattr(found, kind), addresses)] == frames


def test_pressure_lets_readings_of_mtb4_fall_and_counts_rise_to_full_scale():
    counts = load_format("icub-mtb4").counts(np.array([255, 240, 239, 0]))
    assert_array_equal(counts, [-15 << 7, 0, 1 << 7, 0x7FFF])
    assert load_format("linkerhand").counts(np.array([255])) == 0x7FFF


@pytest.mark.parametrize(
    ("last", "healthy", "fault"),
    [
        ("C0000000000000 00", range(10), ""),
        ("C0000000000000 80", [0, 1, 2, 4, 5, 6, 7, 8, 9], ""),  # t3
        ("C0000000000004 00", [0, 1, 2, 3, 4, 5, 6, 7, 8, 9], ""),  # t6 is no tactel
        ("C0000000000080 00", range(9), ""),  # t11
        ("C0000000000000 01", [], "the chip does not acknowledge"),
        ("C0000000000000 02", [], "the triangle is not connected"),
    ],
)
def test_masks_of_mtb4_say_which_tactels_work(last, healthy, fault):
    receiver = Receiver(load_format("icub-mtb4"), ["1.0"])
    receiver.take(frame("410#4000000000000000"))
    receiver.take(Frame(0x410, bytes.fromhex(last)))
    assert list(np.flatnonzero(receiver.newest(0).healthy)) == list(healthy)
    assert receiver.faults == [fault]


@pytest.mark.parametrize(
    "stray",
    [
        frame("410#40000000000000"),  # a byte short
        frame("410#4100000000000000"),  # of no known kind
        frame("411#4000000000000000"),  # another triangle
        frame("410#4000000000000000", flags=RTR),
        frame("410#4000000000000000", flags=EXTENDED),
    ],
)
def test_foreign_frames_change_nothing_and_are_counted(stray):
    receiver = Receiver(load_format("icub-mtb4"), ["1.0"])
    receiver.take(stray)
    receiver.take(frame("410#C000000000000000"))
    assert receiver.n_foreign == 1
    assert not receiver.newest(0).healthy.any()


def test_a_sample_is_never_put_together_from_two_periods():
    receiver = Receiver(load_format("icub-mtb4"), ["1.0"])
    ms = 1_000_000
    receiver.take(frame("410#C011111111110000", 0))  # its first half was lost
    receiver.take(frame("410#4022222222222222", 50 * ms))
    assert not receiver.newest(50 * ms).healthy.any()
    receiver.take(frame("410#C022222222220000", 51 * ms))
    sample = receiver.newest(51 * ms)
    assert_array_equal(sample.counts, (240 - 0x22) << 7)
    assert sample.t_ns == [50 * ms]


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 10**9)), max_size=60))
def test_no_frame_raises(frames):
    for name in format_names():
        receiver = Receiver(load_format(name), [".".join("7" for _ in load_format(name).address)])
        for each in frames:
            receiver.take(Frame(*each))
        receiver.newest(10**9)


@pytest.mark.parametrize("address", ["", "1", "1.16", "16.0", "1.2.3", "a.b", "1.-1", "1.٣"])
def test_an_address_that_the_format_has_not_is_refused(address):
    with pytest.raises(ArgumentError, match="address"):
        load_format("icub-mtb4").parts(address)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('id = "100bbbbtttt"', 'id = "100bbbbttt"', "pattern"),
        ('id = "100bbbbtttt"', 'id = "100bbbbqqqq"', "letters"),
        ('id = "100bbbbtttt"', 'id = "1000000tttt"', "letters b of the address"),
        ('data = "C0"', 'data = "C"', "pattern"),
        ("byte = 1\ntactels = [6", "byte = 4\ntactels = [6", "within 8"),
        ("tactels = [6, 7, 8, -1, 9]", "tactels = [6, 7, 8, -1, 8]", "each of 10 tactels once"),
        ("period_ms = 50", "period_ms = 0", "period_ms"),
        ("n_tactels = 10", "n_tactels = 65", "n_tactels"),
        ("gain = -128", 'gain = "x"', "gain"),
        ('type = ">u2"', 'type = ">f8"', "type"),
        ('address = { b = "board", t = "triangle" }', "address = { b = 1, t = 2 }", "a text"),
        ("zero = 240", 'zero = 240\noffset = { q = "x" }', "offset"),
        ("address = {", "adress = {", "adress"),
        ("byte = 6, type", "byte = 6, typ", "typ"),
    ],
)
def test_a_wrong_format_is_refused_with_the_key(tmp_path, old, new, message):
    written = (FORMATS / "icub-mtb4.toml").read_text()
    assert old in written
    with pytest.raises(ConfigError, match=message):
        load_format(put(tmp_path, "mine.toml", written.replace(old, new)))
