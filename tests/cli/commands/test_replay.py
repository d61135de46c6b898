"""`skinbus replay`, as somebody who saw a wrong contact in the field uses it."""

import csv
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from skinbus.can.candump import format_line
from skinbus.can.frame import ERROR, RTR, Frame
from tests.cli.commands.recordings import EPOCH_NS, changed, frames_in
from tests.cli.invoke import run
from tests.files import put
from tests.master.rig import MS

pytestmark = pytest.mark.slow

READINGS = (0x181, 0x281, 0x381, 0x481)


def replay(*args, **settings):
    return run("replay", *args, **settings)


@pytest.fixture(scope="module")
def plain(field, tmp_path_factory):
    """What is said of the recording, and the file of its contacts."""
    out = tmp_path_factory.mktemp("plain") / "contacts.csv"
    return replay(field, "--arm", "pad", "--out", out), out


def test_contacts_of_every_cycle_are_those_that_were_published(field, plain):
    said, rows = plain[0], list(csv.DictReader(plain[1].read_text().splitlines()))
    lines = said.splitlines()
    assert lines[0].endswith("299 cycles at 100 Hz, level fit")
    first, *_ = (line.split() for line in lines if line.startswith("      1  plate"))
    assert [float(cell) for cell in first[2:5]] == pytest.approx([0.5, 2.5, 28.0], abs=0.05)
    assert "readings: 1188 frames used, 0 late, 0 missing, 0 of wrong length" in said
    assert "left out" not in said
    published = [f.data for f in frames_in(field) if 0x681 <= f.can_id <= 0x690 and f.data[1] >> 4]
    assert len(rows) == len(published) > 150
    for row, data in zip(rows, published, strict=True):
        assert int(row["id"]) == data[0]
        assert abs(1e3 * float(row["s_m"]) - 0.1 * int.from_bytes(data[2:4], "little", signed=True)) < 0.06
        assert abs(float(row["force_n"]) - 0.01 * int.from_bytes(data[6:8], "little")) < 0.006
        assert (row["link"], row["level"]) == ("plate", "fit")
    syncs = [frame.t_ns for frame in frames_in(field) if frame.can_id == 0x80]
    assert {int(row["t_ns"]) for row in rows} <= {t_ns // 1000 * 1000 for t_ns in syncs}


def test_a_log_from_a_pipe_gives_the_same_bytes(field, plain, tmp_path):
    (said, first), again, pipe = plain, tmp_path / "again.csv", tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor() as writer:
        writer.submit(pipe.write_bytes, field.read_bytes())
        piped = replay(pipe, "--arm", "pad", "--out", again).splitlines()
    assert piped[1:-1] == said.splitlines()[1:-1]
    assert again.read_bytes() == first.read_bytes()


def test_garbage_is_counted_and_changes_nothing(field, plain, tmp_path):
    lines = []
    for k, line in enumerate(field.read_text().splitlines()):
        lines.append(line)
        if k % 100 == 50:
            lines += ["", "garbage \x7f", "(1.0) can0 FFF#00", "DROPCOUNT: dropped 2 CAN frames on 'can0' x"]
    last_ns = frames_in(field)[-1].t_ns
    lines += [format_line(Frame(2, bytes(8), last_ns, ERROR)), format_line(Frame(1, b"", last_ns, RTR))]
    *same, left_out, dropped = replay(changed(tmp_path, lines), "--arm", "pad").splitlines()
    assert same[1:] == plain[0].splitlines()[1 : len(same)]
    n = sum(line == "garbage \x7f" for line in lines)
    assert left_out == (
        f"left out: 1 error frame; 1 remote frame; {2 * n} lines without a frame, the first at line 53"
    )
    assert dropped == f"the recorder had no room for {2 * n} frames"


def test_of_two_interfaces_one_is_chosen_by_option_or_arm_file_or_asked_for(field, tmp_path):
    frames = frames_in(field)
    lines = []
    for frame in frames:
        other = format_line(Frame(0x181, bytes(3), frame.t_ns), channel="vcan1")
        lines += [format_line(frame), other]
    path = changed(tmp_path, lines)
    asked = replay(path, "--arm", "pad", status=2)
    assert f"can0 ({len(frames)} frames), vcan1 ({len(frames)} frames): say by --channel" in asked
    pad = Path("skinbus/config/arms/pad.toml").read_text()
    arm = put(
        tmp_path,
        "arm.toml",
        pad.replace("[[link]]", '[[bus]]\nname = "skin"\nchannel = "can0"\n\n[[link]]', 1),
    )
    for args in (("pad", "-c", "can0"), (arm,)):
        chosen = replay(path, "--arm", *args)
        assert "1188 frames used" in chosen
        assert f"left out: {len(frames)} frames of vcan1" in chosen
    wrong = replay(path, "--arm", "pad", "-c", "can7", status=1)
    assert "It also holds can0, vcan1" in wrong


def test_events_are_reported_at_their_times(field, tmp_path):
    lines = [
        format_line(f)
        for f in frames_in(field)
        if f.can_id not in READINGS or not 1000 * MS < f.t_ns - EPOCH_NS < 2000 * MS
    ]
    path = changed(tmp_path, lines)
    lost, back, *_ = replay(path, "--arm", "pad").splitlines()
    assert lost.split() == ["1.029", "s", "readings-lost:", "node", "1"]
    assert back.split()[1:] == ["s", "patch-back:", "node", "1"]
    assert 2.0 < float(back.split()[0]) < 2.2  # silent patches are asked now and then


def test_readings_without_sync_are_no_cycles_and_it_is_said(field, tmp_path):
    path = changed(tmp_path, [format_line(f) for f in frames_in(field) if f.can_id in READINGS])
    result = replay(path, "--arm", "pad", status=1)
    assert "no SYNC is in it" in result


def test_patches_that_sent_nothing_are_named_and_another_arm_is_a_no(field, tmp_path):
    some = replay(field, "--arm", "forearm")
    assert "at 100 Hz (the arm file says 50)" in some
    assert "no readings of nodes 2-24" in some
    path = changed(tmp_path, [format_line(Frame(0x80, b"", n * MS)) for n in range(100)])
    none = replay(path, "--arm", "pad", status=1)
    assert "no patch of pad answered a SYNC with readings: is it the log of another arm?" in none
