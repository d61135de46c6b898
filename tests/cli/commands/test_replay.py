"""`skinbus replay`, as somebody who saw a wrong contact in the field uses it."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from skinbus.bus.recorder import Recorder
from skinbus.can.candump import CandumpReader, CandumpWriter, format_line
from skinbus.can.frame import ERROR, RTR, Frame
from skinbus.cli import group
from tests.cli.commands.wall_clock import EPOCH_NS, WallClock
from tests.master.buses_rig import ON_LEFT, ON_SEAM, BusesRig, write_scene
from tests.master.rig import MS, Rig

SECONDS = 3.0
"""Two touches: one ends, the other begins with the end."""


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """A recording of the scene pad, from the boot of its patches on."""
    path = tmp_path_factory.mktemp("field") / "field.log"
    rig = Rig("pad", level="fit")
    with CandumpWriter(path, clock=WallClock()) as writer:
        rig.wire.tap(writer)
        rig.run(SECONDS * 1e3)
        now_ns = rig.wire.now_ns
        writer.write([frame._replace(t_ns=now_ns) for frame in rig.master.stop(now_ns)])
    return path


def replay(*args, **settings):
    return CliRunner().invoke(group, ["replay", *map(str, args)], **settings)


def frames_in(path):
    return list(CandumpReader(path))


def changed(tmp_path, lines):
    """A file of these lines."""
    path = tmp_path / "changed.log"
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


@pytest.mark.slow
def test_contacts_of_a_recording_are_shown_from_touch_to_lift_and_are_those_that_were_published(field):
    result = replay(field, "--arm", "pad", "--compare")
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].endswith("299 cycles at 100 Hz, level fit")
    first, *_ = (line.split() for line in lines if line.startswith("      1  plate"))
    assert abs(float(first[2]) - 0.5) < 0.05
    assert abs(float(first[3]) - 2.5) < 0.05
    assert abs(float(first[4]) - 28.0) < 1.0
    assert "readings: 1188 frames used, 0 late, 0 missing, 0 of wrong length" in result.output
    assert "compared: 299 of 299 cycles have the same contacts" in lines
    assert "left out" not in result.output


def test_the_file_of_every_cycle_holds_what_was_published(field, tmp_path):
    out = tmp_path / "contacts.csv"
    assert replay(field, "--arm", "pad", "--out", out).exit_code == 0
    rows = list(csv.DictReader(out.read_text().splitlines()))
    published = [f.data for f, _ in frames_in(field) if 0x681 <= f.can_id <= 0x690 and f.data[1] >> 4]
    assert len(rows) == len(published) > 150
    for row, data in zip(rows, published, strict=True):
        assert int(row["id"]) == data[0]
        assert abs(float(row["s_mm"]) - 0.1 * int.from_bytes(data[2:4], "little", signed=True)) < 0.06
        assert abs(float(row["force_n"]) - 0.01 * int.from_bytes(data[6:8], "little")) < 0.006
        assert row["link"] == "plate"
        assert (row["level"], row["state"]) == ("fit", row["state"]) or row["state"] in ("coast", "lift")
    times = [float(row["time"]) - EPOCH_NS * 1e-9 - float(row["t_s"]) for row in rows]
    assert max(map(abs, times)) < 1e-3


def test_the_same_log_gives_the_same_bytes(field, tmp_path):
    outputs = []
    for name in ("a", "b"):
        out = tmp_path / f"{name}.csv"
        result = replay(field, "--arm", "pad", "--out", out, "--json", tmp_path / name)
        said = result.output.replace(str(out), "")
        outputs.append((said, out.read_bytes(), (tmp_path / name).read_bytes()))
    assert outputs[0] == outputs[1]


def test_a_log_cut_at_the_beginning_and_in_its_last_line_works(field, tmp_path):
    text = field.read_text()
    path = tmp_path / "cut.log"
    path.write_text(text[len(text) // 3 + 7 : -9])
    result = replay(path, "--arm", "pad")
    assert result.exit_code == 0
    assert "left out: 1 line that is no frame, at line 1; the last line, which is not whole" in result.output
    assert " 0 missing" in result.output


def test_garbage_is_counted_and_changes_nothing(field, tmp_path):
    lines = []
    for k, line in enumerate(field.read_text().splitlines()):
        lines.append(line)
        if k % 100 == 50:
            lines += ["", "garbage \x7f", "(1.0) can0 FFF#00", "DROPCOUNT: dropped 2 CAN frames on 'can0' x"]
    frame = frames_in(field)[-1][0]
    lines += [format_line(Frame(2, bytes(8), frame.t_ns, ERROR)), format_line(Frame(1, b"", frame.t_ns, RTR))]
    plain = replay(field, "--arm", "pad").output.splitlines()
    result = replay(changed(tmp_path, lines), "--arm", "pad")
    assert result.exit_code == 0
    *same, left_out, dropped = result.output.splitlines()
    assert same[1:] == plain[1:]
    n = sum(line == "garbage \x7f" for line in lines)
    assert left_out == (
        f"left out: 1 error frame; 1 remote frame; {2 * n} lines that are no frames, the first at line 53"
    )
    assert dropped == f"the recorder had no room for {2 * n} frames"


@pytest.mark.slow
def test_of_two_interfaces_one_is_chosen_by_the_option_or_asked_for(field, tmp_path):
    frames = [frame for frame, _ in frames_in(field)]
    lines = []
    for frame in frames:
        lines += [format_line(frame, channel="can0"), format_line(Frame(0x181, bytes(3), frame.t_ns))]
        lines[-1] = lines[-1].replace("can0", "vcan1")
    path = changed(tmp_path, lines)
    asked = replay(path, "--arm", "pad")
    assert asked.exit_code == 2
    assert f"can0 ({len(frames)} frames), vcan1 ({len(frames)} frames): say by --channel" in asked.output
    chosen = replay(path, "--arm", "pad", "-c", "can0", "--compare")
    assert chosen.exit_code == 0
    assert "299 of 299" in chosen.output
    assert f"left out: {len(frames)} frames of vcan1" in chosen.output
    wrong = replay(path, "--arm", "pad", "-c", "can7")
    assert wrong.exit_code == 1
    assert "It also holds can0, vcan1" in wrong.output


def test_an_arm_file_with_a_channel_says_which_interface_it_is(field, tmp_path):
    arm = tmp_path / "arm.toml"
    pad = Path("skinbus/config/arms/pad.toml").read_text()
    arm.write_text(pad.replace("[[link]]", '[[bus]]\nname = "skin"\nchannel = "can0"\n\n[[link]]', 1))
    other = format_line(Frame(0x123, b"", EPOCH_NS), channel="can1")
    path = changed(tmp_path, [other, *field.read_text().splitlines()])
    result = replay(path, "--arm", arm, "--compare")
    assert result.exit_code == 0, result.output
    assert "299 of 299" in result.output


@pytest.mark.slow
def test_two_buses_in_one_log_are_the_buses_of_the_arm(tmp_path):
    rig = BusesRig(write_scene(tmp_path, [ON_LEFT, ON_SEAM]), level="fit")
    log = tmp_path / "both.log"
    with CandumpWriter(log, channels=["can4", "can7"]) as writer:
        rig.wires.attach(Recorder(writer, 2))
        rig.run(1500)
    arm = tmp_path / "arm.toml"
    result = replay(log, "--arm", arm, "-c", "right=can7", "-c", "left=can4", "--compare")
    assert result.exit_code == 0, result.output
    n = len(rig.reports)
    assert f"compared: {n - 1} of {n - 1} cycles have the same contacts" in result.output
    asked = replay(log, "--arm", arm, "-c", "left=can4")
    assert asked.exit_code == 2
    assert (
        'say by --channel right=... (channel={"right": ...} in Python) which of them bus right is'
        in asked.output
    )
    same = replay(log, "--arm", arm, "-c", "left=can4", "-c", "right=can4")
    assert same.exit_code == 2
    assert "bus right is on can4, as another bus is" in same.output
    swapped = replay(log, "--arm", arm, "-c", "left=can7", "-c", "right=can4", "--compare")
    assert swapped.exit_code == 1


def test_events_are_reported_at_their_times(field, tmp_path):
    readings = (0x181, 0x281, 0x381, 0x481)
    lines = [
        format_line(f)
        for f, _ in frames_in(field)
        if f.can_id not in readings or not 1000 * MS < f.t_ns - EPOCH_NS < 2000 * MS
    ]
    result = replay(changed(tmp_path, lines), "--arm", "pad")
    lost, back, *_ = result.output.splitlines()
    assert lost.split() == ["1.029", "s", "readings-lost:", "node", "1"]
    assert back.split()[1:] == ["s", "patch-back:", "node", "1"]
    assert 2.0 < float(back.split()[0]) < 2.2  # silent patches are asked now and then
    later = replay(changed(tmp_path, lines), "--arm", "pad", "--from", 1.5)
    assert "readings-lost" not in later.output
    assert "patch-back" in later.output


def test_what_candump_shows_on_a_screen_gives_the_same(field, tmp_path):
    lines = [
        f" ({f.t_ns // 10**9}.{f.t_ns // 1000 % 10**6:06d})  can0  {f.can_id:03X}   [{len(f.data)}]  "
        + f.data.hex(" ").upper()
        for f, _ in frames_in(field)
    ]
    shown = replay(changed(tmp_path, lines), "--arm", "pad").output
    assert shown.splitlines()[1:] == replay(field, "--arm", "pad").output.splitlines()[1:]


def test_readings_alone_are_enough(field, tmp_path):
    lines = [format_line(f) for f, _ in frames_in(field) if f.can_id in (0x181, 0x281, 0x381, 0x481)]
    result = replay(changed(tmp_path, lines), "--arm", "pad")
    assert result.exit_code == 0
    assert "cycles at 100 Hz, without SYNC" in result.output
    assert "      1  plate" in result.output
    compared = replay(changed(tmp_path, lines), "--arm", "pad", "--compare")
    assert compared.exit_code == 1
    assert "nothing to compare: no master with node-ID 127" in compared.output


def test_a_time_of_the_log_shows_what_it_would_have_shown_of_it_anyway(field, tmp_path):
    whole, part = tmp_path / "whole.csv", tmp_path / "part.csv"
    replay(field, "--arm", "pad", "--out", whole)
    result = replay(field, "--arm", "pad", "--from", 1.2, "--to", 1.8, "--out", part, "--compare")
    assert result.exit_code == 0
    assert "60 cycles" in result.output.splitlines()[0]
    assert "60 of 60" in result.output
    rows = whole.read_text().splitlines()
    assert part.read_text().splitlines() == rows[:1] + [
        row for row in rows[1:] if 1.2 <= float(row.split(",")[1]) <= 1.8
    ]


def test_another_level_is_a_difference_and_status_1(field):
    result = replay(field, "--arm", "pad", "--level", "kmeans", "--compare")
    assert result.exit_code == 1
    assert "cycles, the first at 0.5" in result.output


def test_summary_for_a_program(field, tmp_path):
    result = replay(field, "--arm", "pad", "--compare", "--json", "-")
    told = json.loads(result.stdout)
    assert (told["cycles"], told["rate_hz"], told["level"], told["silent"]) == (299, 100.0, "fit", [])
    assert told["frames"]["readings"] == {"used": 1188, "late": 0, "bad_length": 0, "missing": 0}
    assert told["contacts"][0]["link"] == "plate"
    assert told["compared"]["same"] == 299
    assert told["compared"]["first_s"] is None
    assert "contact  link" in result.stderr


@pytest.mark.slow
def test_a_recording_comes_through_a_pipe(field):
    command = [sys.executable, "-m", "skinbus", "replay", "-", "--arm", "pad", "--compare"]
    with field.open() as file:
        result = subprocess.run(command, stdin=file, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    assert "299 of 299" in result.stdout


def test_patches_that_sent_nothing_are_named_and_another_arm_is_a_no(field, tmp_path):
    some = replay(field, "--arm", "forearm")
    assert some.exit_code == 0
    assert "at 100 Hz (the arm file says 50)" in some.output
    assert "no readings of nodes 2-24" in some.output
    path = changed(tmp_path, [format_line(Frame(0x123, bytes(8), n * MS)) for n in range(100)])
    none = replay(path, "--arm", "pad")
    assert none.exit_code == 1
    assert "no patch of pad sent readings" in none.output


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (
            ("none.log", "--arm", "pad"),
            ("none.log", "wanted one that can be read (No such file or directory)"),
        ),
        (("{log}",), ("--arm",)),
        (("{log}", "--arm", "pod"), ("pod", "pad")),
        (("{log}", "--arm", "{log}"), ("line 1",)),
        (("{log}", "--arm", "pad", "--from", "5", "--to", "3"), ("--to 3", "--from 5")),
        (("{log}", "--arm", "pad", "--from", "nan"), ("finite",)),
        (("{log}", "--arm", "pad", "--node-id", "1"), ("--node-id 1", "patch of pad")),
        (("{log}", "--arm", "pad", "--out", "/no/such/folder/x.csv"), ("/no/such/folder",)),
        (("{log}", "--arm", "arm-two-buses"), ("can0", "--channel upper=", "--channel lower=")),
        (("{log}", "--arm", "pad", "-c", "can0", "-c", "can1"), ("2 channels",)),
        (("{log}", "--arm", "pad", "--out", "{log}"), ("it would be lost",)),
        (("{log}", "--arm", "pad", "--json", "{log}"), ("it would be lost",)),
        (("{pauses}", "--arm", "pad"), ("times", "go back", "candump -l")),
        (("{binary}", "--arm", "pad"), ("binary", "fault", "candump")),
        (("{empty}", "--arm", "pad"), ("empty",)),
    ],
)
def test_wrong_word_or_file_is_one_clear_message_and_status_2(field, tmp_path, args, words):
    (tmp_path / "binary").write_bytes(bytes(range(256)) * 1000)
    (tmp_path / "empty").touch()
    pauses = [format_line(Frame(0x80, b"", k * 2311 % 7000 * 1000)) for k in range(1000)]
    (tmp_path / "pauses").write_text("\n".join(pauses) + "\n")
    files = {name: str(tmp_path / name) for name in ("binary", "empty", "pauses")} | {"log": str(field)}
    before = field.read_bytes()
    result = replay(*(arg.format(**files) for arg in args))
    said = result.output + str(result.exception or "")
    # Refusals of files are told by the door of the whole program: test_door.
    assert result.exit_code == 2 or type(result.exception).__name__ == "ConfigError"
    for word in words:
        assert word in said
    assert field.read_bytes() == before
