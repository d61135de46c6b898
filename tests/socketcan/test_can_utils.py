"""can-utils beside us: candump shows what we send, and what cansend and canplayer send we survive."""

import random
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from skinbus.bus.socketcan import SocketCanBus
from tests.cli.patience import TRIES
from tests.socketcan.frames import EVERY_KIND
from tests.socketcan.hostile import SEED, assert_serves, cansend_text, hostile_frame
from tests.socketcan.skin_rig import CONTACT, PATIENCE_S, SYNC, Skin

N_CANPLAYER, N_CANSEND = 500, 100
"""Of the hostile frames; canplayer rests a tick (10 ms) after each, and cansend is a process each.

``bench.py hostile`` sends ten thousand by cansend.
"""


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


def test_what_canplayer_and_cansend_do_to_the_bus_is_survived(channel, tmp_path):
    print("seed", SEED)
    rng = random.Random(SEED)
    log = tmp_path / "hostile.log"
    texts = [cansend_text(hostile_frame(rng)) for _ in range(N_CANPLAYER)]
    log.write_text("".join(f"(0.000000) {channel} {text}\n" for text in texts))
    with Skin(tmp_path, channel) as skin:
        subprocess.run(
            ["canplayer", "-t", "-I", str(log), f"{channel}={channel}"], check=True, timeout=PATIENCE_S
        )
        script = "".join(f"cansend {channel} {text}\n" for text in texts[:N_CANSEND])
        subprocess.run(["sh", "-e"], input=script, text=True, check=True, timeout=PATIENCE_S)
        over_s = time.monotonic()
        skin.wait_for(lambda: skin.pressed(over_s), "the contact")
        assert_serves(skin, channel)
