"""candump beside us shows what we send."""

import shutil
import subprocess
import time
from pathlib import Path

import pytest

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.frame import EXTENDED, RTR
from tests.cli.patience import TRIES
from tests.socketcan.frames import EVERY_KIND
from tests.socketcan.skin_rig import CONTACT, PATIENCE_S, SYNC, Skin


def cansend_text(frame):
    """The frame as cansend(1) wants it."""
    head = f"{frame.can_id:08X}" if frame.flags & EXTENDED else f"{frame.can_id:03X}"
    return head + (f"#R{len(frame.data)}" if frame.flags & RTR else f"#{frame.data.hex().upper()}")


@pytest.fixture(autouse=True)
def can_utils():
    assert shutil.which("candump"), "can-utils are not installed: apt-get install can-utils"


@pytest.fixture
def candump(channel):
    """Start candump for so many frames and wait until it listens; called again: what it printed."""
    listeners = Path("/proc/net/can/rcvlist_all")
    processes = []

    def start(n):
        before = listeners.read_text().count(f" {channel} ")
        processes.append(
            subprocess.Popen(["candump", "-L", "-n", str(n), channel], stdout=subprocess.PIPE, text=True)
        )
        give_up_s = time.monotonic() + PATIENCE_S
        while listeners.read_text().count(f" {channel} ") == before:
            assert time.monotonic() < give_up_s

        def printed():
            out, _ = processes[-1].communicate(timeout=PATIENCE_S)
            return [line.split()[2] for line in out.splitlines()]

        return printed

    yield start
    for process in processes:
        process.kill()
        process.wait()


def test_candump_shows_every_kind_of_frame_as_it_was_sent(candump, channel):
    printed = candump(len(EVERY_KIND))
    with SocketCanBus(channel) as sender:
        assert sender.send(EVERY_KIND) == len(EVERY_KIND)
    assert [line.removesuffix("R0") for line in printed()] == [cansend_text(frame) for frame in EVERY_KIND]


def test_candump_shows_a_master_and_its_patches_at_work(candump, channel, tmp_path):
    wanted = {f"{can_id:03X}" for can_id in (SYNC, 0x181, 0x281, 0x381, 0x481, CONTACT, 0x1FF)}
    with Skin(tmp_path, channel):
        for _ in range(TRIES):
            lines = candump(1000)()
            heads = {line.partition("#")[0] for line in lines}
            if wanted <= heads:  # else the machine was too busy to publish a contact
                break
    assert wanted <= heads
    contacts = [line for line in lines if line.startswith(f"{CONTACT:03X}#")]
    assert all(len(line) == 4 + 16 for line in contacts)
