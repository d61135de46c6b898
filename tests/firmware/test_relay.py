"""The stop relay: closed while all guarded patches are armed, and once open for ever."""

import ctypes as c
import subprocess
from pathlib import Path

import pytest

from skinbus.config.arm_file import find_arm
from skinbus.firmware import write_relay
from skinbus.objects.guard import GFC_ID
from tests.cli.invoke import run
from tests.files import put
from tests.firmware.firmware_device import WARNINGS
from tests.firmware.test_firmware import assert_builds

PATCHES = [0x501, 0x505, 0x6B7]
SILENT_US = 50_000
GUARD = """
[guard]
liveness_ms = 20
[[guard.region]]
name = "all"
patches = [1]
force_n = 30.0
source = "a test"
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder = tmp_path_factory.mktemp("relay")
    write_relay("arm.toml", PATCHES, SILENT_US, folder)
    sources = [folder / "core/relay.c", folder / "board.c", Path(__file__).parent / "relay.c"]
    places = [f"-I{folder}", f"-I{folder / 'core'}"]
    subprocess.run(
        ["cc", *WARNINGS, "-shared", "-fPIC", *places, "-o", folder / "relay.so", *sources], check=True
    )
    own = c.CDLL(str(folder / "relay.so"))
    own.step.restype = c.c_bool
    return own


class Relay:
    """A relay after power-on, near the wrap-around of its clock."""

    def __init__(self, library):
        self.library, self.now_us = library, 2**32 - 100_000
        library.start()

    def hear(self, can_id=0xFFFF, *data):
        return self.library.step(self.now_us % 2**32, can_id, len(data), *(data[:1] or (0,)))

    def arm(self):
        return [self.hear(can_id, 1, 0) for can_id in PATCHES][-1]

    def wait(self, us):
        self.now_us += us
        return self.hear()


@pytest.fixture
def relay(library):
    return Relay(library)


def test_it_closes_when_the_last_patch_is_armed(relay):
    assert not relay.wait(1000)
    assert [relay.hear(can_id, 1, 0) for can_id in PATCHES] == [False, False, True]


def test_it_stays_closed_while_they_live_and_one_frame_may_be_lost(relay):
    assert relay.arm()
    for _ in range(100):
        assert relay.wait(20_000)
        assert relay.wait(20_000)
        assert relay.arm()
        assert relay.hear(0x181, 3)


@pytest.mark.parametrize("state", [0, 2, 3, 0x81])
def test_a_state_that_is_not_exactly_armed_opens_it_for_ever(relay, state):
    assert relay.arm()
    assert not relay.hear(PATCHES[1], state, 0)
    assert not relay.arm()


def test_a_state_without_data_opens_it(relay):
    assert relay.arm()
    assert not relay.hear(PATCHES[2])


def test_silence_of_one_patch_opens_it_for_ever(relay):
    assert relay.arm()
    assert relay.wait(SILENT_US)
    for can_id in PATCHES[:2]:
        assert relay.hear(can_id, 1, 0)
    assert not relay.wait(1)
    assert not relay.arm()


@pytest.mark.parametrize("is_closed", [False, True])
def test_gfc_opens_it_for_ever_and_keeps_it_open(relay, is_closed):
    assert (relay.arm() if is_closed else relay.hear(PATCHES[0], 1, 0)) == is_closed
    assert not relay.hear(GFC_ID)
    assert not relay.arm()


def test_project_of_an_arm_builds_as_it_is_written(tmp_path):
    arm = put(tmp_path, "arm.toml", find_arm("pad").read_text() + GUARD)
    said = run("board", "firmware", "--relay", arm, "--out", tmp_path / "own")
    assert "1 patch, open after 50 ms of silence" in said
    assert_builds(tmp_path / "own")
