"""New programs for boards, in C and simulated: losses of power, the order of Zephyr's runner, failures."""

import random
import struct
import subprocess

import pytest

from skinbus.can.core import Core
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.firmware import write_project
from skinbus.master.commissioning.flash import Flasher
from skinbus.node import Device
from skinbus.objects.eds import load_eds
from skinbus.objects.program_image import read_image
from tests.firmware.firmware_device import EMPTY, PAGE, FirmwareDevice, code_of
from tests.firmware.images import make_image
from tests.firmware.traffic import Traffic

NODE = 5
BOARD = 0x534B4E42, 0x5001


OLD, NEW = (make_image(bytes(200), *BOARD, version) for version in (1, 2))


class Firmware:
    """A board in C, whose flash holds the old program."""

    def __init__(self):
        self.kept = bytearray(EMPTY)
        self.kept[2 * PAGE : 2 * PAGE + len(OLD)] = OLD

    def power_on(self, n_writes=2**32 - 1):
        device = FirmwareDevice(code_of("skin-patch"), NODE, flash=self.kept, n_writes=n_writes)
        device.step(10**9)
        return device

    def holds(self, image):
        """Whether a program is there to the last byte."""
        return image[8:] in self.kept


class Simulated:
    """The simulated patch; its storage holds the old program."""

    def __init__(self):
        self.kept = {"program": f"{read_image(OLD)[0]:08x}{OLD.hex()}"}

    def power_on(self, n_writes=0):
        device = Device(load_eds("skin-patch", NODE), NODE, storage=self.kept)
        device.step(10**9)
        return device

    def holds(self, image):
        return any(text.endswith(image.hex()) for text in self.kept.values())


BOARDS = pytest.mark.parametrize("board", [Firmware, Simulated])


def running(device):
    asked = Frame(0x600 + NODE, struct.pack("<BHB4x", 0x40, 0x1F56, 1))
    return int.from_bytes(device.step(10**9, [asked]).frames[0].data[4:], "little")


@pytest.mark.slow
@pytest.mark.parametrize(("board", "n_losses"), [(Firmware, 300), (Simulated, 100)])
def test_loss_of_power_at_any_frame_leaves_the_old_program_or_the_new(board, n_losses):
    """Also within a word and within an erasing; the next download goes on from there."""
    rng, own, counts = random.Random(4), board(), [0, 0]
    traffic = Traffic(own.power_on().layout, NODE, 1)
    images = {read_image(OLD)[0]: OLD}
    for _ in range(n_losses):
        before = running(own.power_on())
        frames = [traffic.program(), *traffic.left]
        crc = read_image(traffic.image)[0]
        images[crc] = traffic.image
        device = own.power_on(rng.choice((2**32 - 1, rng.randrange(1, 14))))
        for frame in frames[: rng.randrange(len(frames))]:
            device.step(10**9, [frame])
        after = running(own.power_on())
        assert after in (before, crc)
        assert own.holds(images[after])
        counts[after == crc] += 1
    assert min(counts) > n_losses // 20


RUNNER = "r 1F57, r 1F56, nmt 80, w 1F51 00, w 1F51 03, r 1F57, w 1F50, r 1F57, r 1F56, w 1F51 01, r 1F56"
"""What canopen_program.py of Zephyr, in ``flash``, reads (r), writes (w) and commands; then it writes 80."""


class Logged(Flasher):
    """Keeps what it sends."""

    def step(self, now_ns, frames):
        step = super().step(now_ns, frames)
        self.log = [*getattr(self, "log", ()), *step.frames]
        return step

    @property
    def said(self):
        for frame in self.log:
            head, index = struct.unpack_from("<BH", frame.data.ljust(3))
            if frame.can_id == 0:
                yield f"nmt {head:02X}"
            elif head >> 5 == 2:
                yield f"r {index:04X}"
            elif head >> 5 == 1:
                yield f"w {index:04X} {frame.data[4]:02X}" if head & 2 else f"w {index:04X}"


def flash(device, image=NEW):
    core = Logged([NODE], image)
    wire = VirtualBus(1_000_000)
    wire.attach(device)
    wire.attach(core)
    wire.run(60 * 10**9)
    return core


@BOARDS
def test_boards_are_flashed_in_the_order_of_zephyrs_runner_and_keep_the_program(board):
    own = board()
    core = flash(own.power_on())
    said = [words for words in core.said if words not in ("r 1018", "r 1F51")]
    assert ", ".join(said) == f"{RUNNER}, nmt 01, nmt 80"
    assert core.results == {NODE: ""}
    assert core.runs == {NODE: running(own.power_on())} == {NODE: read_image(NEW)[0]}
    assert not any(words.startswith("w") for words in flash(own.power_on()).said)


@BOARDS
def test_a_board_of_another_vendor_is_left_alone(board):
    core = flash(board().power_on(), make_image(b"", 1, BOARD[1], 1))
    assert "the image is for" in core.results[NODE]
    assert {*core.said} == {"r 1018"}


class Failing(Core):
    """A board that is silent from a frame on, or to which this segment comes spoilt."""

    def __init__(self, device, begin):
        self.device, self.begin, self.is_spoilt = device, begin, len(begin) == 1

    cob_ids = None

    def step(self, now_ns, frames=()):
        if any(frame.data.startswith(self.begin) and frame.can_id == 0x600 + NODE for frame in frames):
            self.begin = b"never"
            if self.is_spoilt:
                frames = [frame._replace(data=frame.data[:4] + b"\x55" + frame.data[5:]) for frame in frames]
            else:
                self.device = Device(load_eds("skin-patch", NODE), NODE + 1)
        return self.device.step(now_ns, frames)


START = bytes.fromhex("2F 51 1F 01 01")


@BOARDS
@pytest.mark.parametrize(
    ("begin", "words"),
    [
        (START[:4] + b"\3", "0x1F51:01: no answer"),
        (START, "silent after the start"),
        (b"\x10", "0x1F50:01: 0x08000020"),
    ],
)
def test_a_board_that_fails_is_reported_and_keeps_its_old_program(board, begin, words):
    own = board()
    core = flash(Failing(own.power_on(), begin))
    assert words in core.results[NODE]
    assert own.holds(OLD)


@BOARDS
@pytest.mark.parametrize(
    ("busy_s", "result"), [(4, ""), (60, "its flash is not ready: 0x1F57:01 is 1")], ids=["ready", "never"]
)
def test_a_board_that_erases_beside_its_answers_is_waited_for(board, busy_s, result):
    device, core, wire = board().power_on(), Logged([NODE], NEW), VirtualBus(1_000_000)
    device.set(0x1F57, 1, 1)
    for each in (device, core):
        wire.attach(each)
    wire.run(busy_s * 10**9)
    assert "w 1F50" not in core.said
    device.set(0x1F57, 1, 0)
    wire.run(60 * 10**9)
    assert core.results == {NODE: result}


def test_a_project_makes_its_images(tmp_path):
    write_project("skin-patch", tmp_path)
    (tmp_path / "program.bin").write_bytes(b"program")
    subprocess.run(["make", "-s", "image.bin", "VERSION=7"], cwd=tmp_path, check=True)
    assert read_image((tmp_path / "image.bin").read_bytes())[1:] == (*BOARD, 7)
