"""The firmware of a board on the virtual bus: it keeps every rule, and does what the simulated patch does."""

import random
import struct
import subprocess
from pathlib import Path

import pytest

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.firmware import write_project
from skinbus.node import Device
from skinbus.objects.eds import eds_names, find_eds, load_eds
from skinbus.objects.eds_text import EdsText
from skinbus.objects.guard import GFC_ID
from tests.cli.invoke import run
from tests.files import put
from tests.firmware.firmware_device import EMPTY, FLAGS, FirmwareDevice, code_of
from tests.firmware.mutants import SensingFirmware, broken_rules
from tests.firmware.traffic import Traffic
from tests.marks import slow

NODE = 5
MAX_WAKES = 40
"""After so many between two frames the second comes at once: some settings wake a board each millisecond."""
BOARDS = [name for name in eds_names() if name.startswith("skin-patch")]
READING = {name: 0x6400 if name.endswith(("8bit", "8x8")) else 0x6401 for name in BOARDS}


def board(eds="skin-patch", **options):
    return FirmwareDevice(code_of(eds), NODE, flash=bytearray(EMPTY), **options)


@pytest.mark.parametrize("eds", [BOARDS[0], *slow(*BOARDS[1:])])
def test_firmware_of_every_board_keeps_every_rule(eds):
    assert broken_rules(board(eds), eds, n_syncs=50) == {}


def test_a_board_that_senses_passes():
    sensing = SensingFirmware(code_of("skin-patch"))
    assert broken_rules(sensing, n_syncs=500, ask=sensing.press) == {}


def run_both(eds, seed, n_steps):
    """Pass the same traffic to both devices, and compare what they send.

    What differs and is left out: block transfers; the stamp of samples for events; downloads of texts that
    fail, after which the firmware has none.
    """
    pair = Device(load_eds(eds, NODE), NODE, storage={}), board(eds)
    traffic = Traffic(pair[0].layout, NODE, seed)
    said = []
    readings = [device.image_view(READING[eds], 1, 16) for device in pair]
    now_ns, wakes = 1_000_000, [NEVER, NEVER]

    def step(frames):
        pair[0].sampled(
            -len(said)
        )  # a new one with every step, also of the same time, as in the firmware here
        steps = [device.step(now_ns, frames) for device in pair]
        for step in steps:
            if any(frame.can_id == GFC_ID for frame in step.frames):
                step.frames.sort(key=lambda frame: frame.can_id)
        sent = [[(f.can_id, f.data.hex(" "), f.flags) for f in step.frames] for step in steps]
        said.append((now_ns // 1000, [f"{f.can_id:03X} {f.data.hex(' ')}" for f in frames], *sent))
        assert sent[0] == sent[1], "\n".join(map(str, said[-12:]))
        wakes[:] = [step.wake_ns for step in steps]

    step([])
    for _, (us, frame) in zip(range(n_steps), traffic, strict=False):
        until_ns = now_ns + 1000 * us
        for _ in range(MAX_WAKES):
            if min(wakes) > until_ns:
                now_ns = until_ns
                break
            now_ns = -(-min(wakes) // 1000) * 1000  # the firmware counts us
            step([])
        if frame.can_id == 0x80 and not frame.flags:
            for view in readings:
                view[us % 16] = us % 127
        is_block = frame.can_id == 0x600 + NODE and frame.data[:1] and frame.data[0] >> 5 in (5, 6)
        step([] if is_block else [frame._replace(t_ns=now_ns)])
        assert pair[0].cob_ids == pair[1].cob_ids
        if pair[0].node_id != NODE:
            return


@pytest.mark.parametrize("eds", BOARDS)
@pytest.mark.parametrize("seeds", [range(2), *slow(range(2, 12))], ids=str)
def test_firmware_answers_as_the_simulated_patch(eds, seeds):
    for seed in seeds:
        run_both(eds, seed, 1000 if seed > 1 else 200)


def test_age_of_a_sample_is_sent_with_it():
    device = board("skin-patch-fd")
    device.step(1000)
    device.image_view(0x2070, 3, 1)[:] = 123
    (frame,) = device.step(2000, [Frame(0, b"\x01\0"), Frame(0x80)]).frames
    assert frame.data[32:36] == struct.pack("<BBH", 0, 0, 123)


@pytest.mark.slow
def test_random_frames_do_no_harm(tmp_path):
    write_project("skin-patch-fd32", tmp_path)
    sources = [*tmp_path.glob("core/*.c"), tmp_path / "board.c"]
    fuzz = Path(__file__).parent / "fuzz.c"
    sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = [
        "cc",
        *FLAGS,
        "-O1",
        *sanitizers,
        f"-I{tmp_path}",
        f"-I{tmp_path / 'core'}",
        "-o",
        tmp_path / "fuzz",
    ]
    subprocess.run([*command, *sources, fuzz], check=True)
    done = subprocess.run([tmp_path / "fuzz", "7", "250000"], capture_output=True, text=True)
    assert not done.returncode, done.stderr


PARAMETERS = ((0x1017, 0), (0x2030, 1), (0x2040, 0), (0x2031, 7), (0x6426, 3), (0x1020, 1))


def ask(device, data):
    """Return the answer to an SDO request."""
    return device.step(10**9, [Frame(0x600 + NODE, data)]).frames[0].data


def values_of(device):
    return [ask(device, struct.pack("<BHB4x", 0x40, index, sub)) for index, sub in PARAMETERS]


def booted(flash, **options):
    device = FirmwareDevice(code_of("skin-patch"), NODE, flash=flash, **options)
    device.step(10**9)
    return device


@pytest.mark.slow
def test_loss_of_power_while_storing_leaves_the_old_parameters_or_the_new():
    """Also within a word and within an erasing; and whatever was lost, the next store is whole."""
    rng = random.Random(3)
    flash = bytearray(EMPTY)
    n_old = n_new = 0
    for _ in range(200):
        before = values_of(booted(flash))
        device = booted(flash, n_writes=rng.randrange(1, 60))
        for index, sub in PARAMETERS:
            device.set(index, sub, rng.randrange(1, 200))
        wanted = values_of(device)
        stored = ask(device, struct.pack("<BHB4s", 0x23, 0x1010, 1, b"save"))
        after = values_of(booted(flash))
        assert after in (before, wanted)
        assert after == wanted or stored[0] == 0x80
        n_old, n_new = n_old + (after == before), n_new + (after == wanted)
    assert min(n_old, n_new) > 20


def test_parameters_of_another_program_are_not_taken_but_its_node_id_is():
    flash = bytearray(EMPTY)
    device = booted(flash)
    device.set(0x1017, 0, 100)
    ask(device, struct.pack("<BHB4s", 0x23, 0x1010, 1, b"save"))
    for data in (b"\x04\x01", b"\x11\x09", b"\x17"):  # LSS: configure, node-ID 9, store
        device.step(10**9, [Frame(0x7E5, data.ljust(8, b"\0"))])
    other = FirmwareDevice(code_of("skin-patch-8bit"), NODE, flash=flash)
    boot_up, emcy = other.step(10**9).frames
    assert boot_up.can_id == 0x709
    assert (emcy.can_id, emcy.data[:2]) == (0x89, b"\x00\x63")
    assert other.get(0x1017) != 100


@pytest.mark.slow
def test_board_of_ones_own_keeps_every_rule(tmp_path):
    eds = str(tmp_path / "own.eds")
    run("board", "new", "--grid", "6x6", "--pitch-mm", "8", "--out", eds)
    assert broken_rules(board(eds), eds, n_syncs=50) == {}


@pytest.mark.slow
def test_board_with_few_objects_builds_and_keeps_every_rule(tmp_path):
    eds = EdsText(find_eds("skin-patch").read_text())
    gone = ("1016", "100c", "100d", "1400", "1600", "2023", "2070")
    eds.sections = {name: lines for name, lines in eds.sections.items() if name[:4] not in gone}
    objects = [name.upper() for name in eds.sections if len(name) == 4]
    mandatory = ("1000", "1001", "1018")
    eds.list_objects("OptionalObjects", [n for n in objects if n[0] in "16" and n not in mandatory])
    eds.list_objects("ManufacturerObjects", [name for name in objects if name[0] == "2"])
    path = put(tmp_path, "few.eds", eds.text())
    assert broken_rules(board(str(path)), str(path), n_syncs=50) == {}


def assert_builds(project):
    make = ["make", "-s", "-C", project, "socketcan", "skeleton"]
    built = subprocess.run(make, capture_output=True, text=True)
    assert (built.returncode, built.stderr) == (0, "")


@pytest.mark.slow
def test_project_builds_as_it_is_written(tmp_path):
    run("board", "firmware", "skin-patch", "--out", tmp_path / "own")
    assert_builds(tmp_path / "own")


def test_project_is_written_again_but_never_over_other_files(tmp_path):
    put(tmp_path, "Makefile", "mine")
    words = ["board", "firmware", "skin-patch", "--out"]
    assert "holds other files" in run(*words, tmp_path, status=2)
    assert (tmp_path / "Makefile").read_text() == "mine"
    for _ in range(2):
        run(*words, tmp_path / "own")
