"""Patches that send on a change or by a timer of their own, beside others and alone."""

import numpy as np
import pytest

from skinbus.master.patches.table import PatchState
from skinbus.master.replay import Replay
from tests.files import put
from tests.master.heard import listen
from tests.master.rig import MS, Rig

pytestmark = pytest.mark.slow

ARM = """
[arm]
name = "free"
rate_hz = {rate_hz}
[[link]]
name = "plate"
surface = "plane"
length_mm = 160.0
width_mm = 60.0
[[patch]]
node_id = 1
link = "plate"
s_mm = 26.0
set = {first}
[[patch]]
node_id = 2
link = "plate"
s_mm = 78.0
set = {second}
"""
SCENE = """
[scene]
title = "a press on the first board, then on both"
arm = "free.toml"
duration_s = 100.0
[[touch]]
link = "plate"
s_mm = 30.0
a_mm = 4.0
force_n = [[1.0, 0.0], [1.02, 5.0], [2.0, 5.0], [2.02, 0.0]]
[[touch]]
link = "plate"
s_mm = 78.0
a_mm = 0.0
force_n = [[4.0, 0.0], [4.02, 5.0], [5.0, 5.0], [5.02, 0.0]]
"""


def by_events(event_ms=0, *, on_change=True, delta=60):
    """What a patch is set to that runs freely."""
    values = {
        "0x6423": "true" if on_change else "false",
        "0x6421": str([4] * 16),
        "0x6426": str([delta] * 16),
    }
    for index in range(0x1800, 0x1804):
        values |= {f"0x{index:X}:02": 254, f"0x{index:X}:03": 0, f"0x{index:X}:05": event_ms}
    return "{" + ", ".join(f'"{key}" = {value}' for key, value in values.items()) + "}"


class FreeRig(Rig):
    """Two boards on a plate, one of them or both run freely."""

    def __init__(self, folder, first, second, rate_hz=50.0):
        put(folder, "free.toml", ARM.format(rate_hz=rate_hz, first=first, second=second))
        super().__init__(put(folder, "scene.toml", SCENE))
        self.world.on_sample = self.note
        self.offset_ns = 0

    def note(self, now_ns, t_s):
        self.offset_ns = self.offset_ns or now_ns - round(1e9 * t_s)

    def run_to(self, scene_s):
        """Return the cycles until a time of the scene; its first is the first SYNC."""
        if not self.offset_ns:
            self.run(600)
            assert self.offset_ns
        del self.reports[:], self.frames[:]
        self.wire.run(self.offset_ns + round(1e9 * scene_s))
        return list(self.reports)

    @property
    def readings(self):
        """What the boards have sent since then."""
        return [
            frame for frame in self.frames if 0x180 <= frame.can_id < 0x500 and frame.can_id & 0x7F in (1, 2)
        ]

    @property
    def is_fresh(self):
        return all(cycle.fresh.all() for cycle in self.reports)


def test_patch_that_sends_on_change_is_fresh_beside_one_on_sync_and_silent_while_nothing_touches(tmp_path):
    rig = FreeRig(tmp_path, by_events(), "{}")
    rig.run_to(0.8)
    rig.run_to(0.99)
    assert rig.is_fresh
    assert {frame.can_id & 0x7F for frame in rig.readings} == {2}
    rig.run_to(1.1)
    cycles = rig.run_to(1.9)
    assert rig.is_fresh
    assert all(len(cycle.contacts) == 1 for cycle in cycles)
    assert cycles[-1].contacts.force[0] == pytest.approx(5.0, rel=0.2)
    assert len(cycles) == pytest.approx(0.8 * 50, abs=1), "cycles are those of the SYNC"
    rig.run_to(2.2)
    assert not len(rig.run_to(2.5)[-1].contacts)


def test_touch_on_patches_that_all_send_on_change_is_published_at_once_and_idle_costs_nothing(tmp_path):
    rig = FreeRig(tmp_path, by_events(), by_events(), rate_hz=5.0)
    rig.run_to(0.5)
    cycles = rig.run_to(0.99)
    assert not rig.readings
    assert len(cycles) <= 3
    assert rig.is_fresh
    rig.run_to(1.03)
    crossing = min(frame.t_ns for frame in rig.readings)
    (first, *_) = [cycle for cycle in rig.reports if len(cycle.contacts)]
    assert first.t_ns + first.latency_ns - crossing < 5 * MS
    held = rig.run_to(1.9)
    assert len(held) < 10, "nothing changes"
    assert all(len(cycle.contacts) == 1 for cycle in held)
    rig.run_to(2.03)
    assert not len(rig.reports[-1].contacts)
    assert len(rig.run_to(3.0)) < 10


def test_patch_with_a_timer_of_its_own_is_used_with_the_age_of_its_frames(tmp_path):
    rig = FreeRig(tmp_path, by_events(47, on_change=False), "{}")
    rig.run_to(1.1)
    cycles = rig.run_to(1.9)
    assert rig.is_fresh
    ages_ms = [(cycle.t_ns - cycle.tracks.seen_ns[0]) / MS for cycle in cycles]
    assert min(ages_ms) < 15
    assert 30 < max(ages_ms) <= 47
    period = np.diff([frame.t_ns for frame in rig.readings if frame.can_id == 0x181]) / MS
    assert period == pytest.approx(47, abs=2)


@pytest.mark.parametrize(("event_ms", "on_change"), [(40, False), (40, True), (0, True)])
def test_patch_that_is_gone_is_not_used_and_is_again_when_it_is_back(tmp_path, event_ms, on_change):
    rig = FreeRig(tmp_path, by_events(event_ms, on_change=on_change), "{}")
    rig.run_to(1.5)
    assert rig.run_to(1.7)[-1].fresh.tolist() == [True, True]
    rig.patches.unplugged = {1}
    rig.run_to(3.7)  # its heartbeat is lost
    assert {(*cycle.fresh,) for cycle in rig.run_to(4.5)} == {(False, True)}
    assert not rig.master.table.is_running[0]
    rig.patches.unplugged = set()
    rig.run_to(7.0)
    assert rig.reports[-1].fresh.tolist() == [True, True]


def test_what_a_patch_sent_before_it_started_anew_is_not_used(tmp_path):
    rig = FreeRig(tmp_path, by_events(), "{}")
    rig.run_to(1.9)
    rig.world.devices[0].step(
        rig.wire.now_ns, [rig.readings[0]._replace(can_id=0, data=b"\x81\x01", flags=0)]
    )
    rig.world.hosts[0].wake(0, rig.wire.now_ns + 1)
    rig.wire.wake(rig.port)
    cycles = rig.run_to(2.9)
    assert cycles[-1].fresh.tolist() == [True, True]
    assert not len(cycles[-1].contacts), "the press has ended meanwhile"


def test_a_cycle_of_a_recording_that_a_change_began_has_its_time(tmp_path):
    rig = FreeRig(tmp_path, by_events(), by_events(), rate_hz=10.0)
    rig.run_to(1.5)
    began_ns = []
    replay = Replay(rig.scene.arm, on_cycle=lambda report: began_ns.append(report.t_ns + replay.stamp_ns))
    for frame in rig.frames:
        replay.take(frame)
    live_ns = [report.t_ns for report in rig.reports]
    assert np.diff(live_ns).min() < 10 * MS
    assert began_ns == pytest.approx(live_ns[: len(began_ns)], abs=0.2 * MS)


@pytest.mark.parametrize("event_ms", [0, 800])
def test_a_listener_shows_what_a_quiet_patch_has_sent_until_timer_or_heartbeat_are_due(tmp_path, event_ms):
    rig = FreeRig(tmp_path, by_events(event_ms), by_events(event_ms), rate_hz=5.0)
    _, feed = listen(rig)
    rig.run_to(1.9)
    heard = feed.peek()
    assert heard.readings.valid.all()
    assert np.abs(heard.readings.pressures - rig.reports[-1].pressures).max() < 50.0
    assert heard.patch_records["state"].tolist() == [PatchState.OPERATIONAL] * 2
    assert (heard.patch_records["last_fresh_ns"] >= heard.t_ns).all()
    rig.patches.unplugged = {1}
    rig.run_to(3.5)
    heard = feed.peek()
    assert heard.patch_records["state"].tolist() == [PatchState.SILENT, PatchState.OPERATIONAL]
    assert heard.readings.valid.tolist() == [False] * 16 + [True] * 16
