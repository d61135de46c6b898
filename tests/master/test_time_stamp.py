"""TIME is the time of day, as often as the arm file asks for it; without being asked there is none."""

import datetime
import struct

import pytest

from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.arm_file import find_arm
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError
from skinbus.master import Master
from skinbus.objects import cia

NOW = datetime.datetime(2026, 11, 22, 13, 14, 15, 678_000, tzinfo=datetime.UTC)
UNIX_NS = int(NOW.timestamp() * 1000) * 1_000_000
ORIGIN = datetime.datetime(1984, 1, 1, tzinfo=datetime.UTC)


def arm_with(tmp_path, line):
    text = find_arm("pad").read_text().replace("rate_hz", f"{line}\nrate_hz", 1)
    (tmp_path / "arm.toml").write_text(text)
    return load_arm(tmp_path / "arm.toml")


def run(arm, ms, **settings):
    """A master and the TIME messages of some bus time."""
    wire, frames = VirtualBus(arm.bus.bitrate), []
    wire.tap(lambda frame: frames.append(frame) if frame.can_id == cia.TIME_ID else None)
    master = Master(arm, **settings)
    wire.attach(master)
    wire.run(ms * 1_000_000)
    return master.device, frames


def test_it_is_sent_every_so_often_and_is_the_time_of_day(tmp_path):
    device, frames = run(arm_with(tmp_path, "time_stamp_s = 0.5"), 1900, unix_ns=lambda: UNIX_NS)
    assert len(frames) == 4
    ms, days = struct.unpack("<IH", frames[0].data)
    assert ORIGIN + datetime.timedelta(days, milliseconds=ms) == NOW
    assert device.get(cia.TIME_COB_ID) == cia.COB_ID_PRODUCER | cia.TIME_ID
    assert device.get(cia.HIGH_RESOLUTION_TIME) == UNIX_NS // 1000 % 2**32


def test_nobody_who_does_not_ask_gets_it(tmp_path):
    device, frames = run(load_arm("pad"), 1000, unix_ns=lambda: UNIX_NS)
    assert not frames
    assert device.get(cia.TIME_COB_ID) == cia.TIME_ID


def test_one_that_follows_another_master_sends_none(tmp_path):
    arm = arm_with(tmp_path, "time_stamp_s = 0.5")
    assert not run(arm, 1000, unix_ns=lambda: UNIX_NS, follows=True)[1]


def test_a_period_that_would_flood_the_bus_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="time_stamp_s"):
        arm_with(tmp_path, "time_stamp_s = 0.01")
