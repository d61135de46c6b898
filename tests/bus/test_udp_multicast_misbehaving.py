"""Boards that misbehave, on UDP multicast: what is used as fresh was sampled for its SYNC, faults are named.

Two boards in real time, of which the second misbehaves; a reading is the number of the SYNC that it answers.
Tests wait for what must come, and look for a while that what must not come does not.
"""

import os
import threading
import time

import numpy as np
import pytest

from skinbus.bus.loop import run_core
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.core import Core, Step
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.master import Master
from skinbus.objects import cia
from skinbus.sim import World, load_scene
from tests.master.misbehaving import Tool, swapped_mappings
from tests.master.misbehaving_rig import Misbehaving

PATIENCE_S = 60.0
"""Nothing takes that long when all is well."""

LOOK_S = 0.5
BAD = 2

ARM = """
[arm]
name = "two"
rate_hz = 25.0

[[link]]
name = "plate"
surface = "plane"
length_mm = 120.0
width_mm = 60.0

[[patch]]
node_id = 1
link = "plate"
s_mm = 30.0

[[patch]]
node_id = 2
link = "plate"
s_mm = 90.0
"""
SCENE = """
[scene]
arm = "arm.toml"
duration_s = 1000.0
"""


class Skin:
    """A master and two boards, each in a thread; used with ``with``."""

    def __init__(self, folder, group):
        (folder / "arm.toml").write_text(ARM)
        (folder / "scene.toml").write_text(SCENE)
        scene = load_scene(folder / "scene.toml")
        self.group = group
        self.patches = Misbehaving(World(scene))
        self.events, self.fresh, self.violations, self.errors = [], [], [], []
        self.master = Master(scene.arm, on_cycle=self._check)
        self.period_ns = self.master.period_ns
        self._arm = scene.arm
        self._stop = threading.Event()
        self._threads = [self._thread(self.patches, None), self._thread(self.master, self.events.append)]

    def __enter__(self):
        for thread in self._threads:
            thread.start()
        self.wait_for(lambda: self.fresh and self.fresh[-1].all(), "fresh readings")
        return self

    def __exit__(self, *exc):
        self._stop.set()
        for thread in self._threads:
            thread.join()
        assert not self.errors, self.errors
        assert not self.violations, self.violations[:10]

    def wait_for(self, happened, what):
        """Wait until something is so."""
        end_s = time.monotonic() + PATIENCE_S
        while not happened():
            assert not self.errors, self.errors
            assert time.monotonic() < end_s, f"waited {PATIENCE_S} s for {what}; {self.events[-5:]}"
            time.sleep(0.01)

    def wait_for_event(self, kind, node_id=None):
        """Wait until it is in the log."""
        self.wait_for(lambda: kind in self.kinds(node_id), kind)

    def look(self):
        """Return which boards were fresh in the cycles of a while, (n_cycles, 2)."""
        n = len(self.fresh)
        time.sleep(LOOK_S)
        return np.array(self.fresh[n:])

    def kinds(self, node_id=None):
        return [event.kind for event in self.events if node_id in (None, event.node_id)]

    def attach(self, core):
        """Run another core on the interface until the end."""
        self._threads.append(self._thread(core, None))
        self._threads[-1].start()

    def _check(self, report):
        self.fresh.append(report.fresh.copy())
        for p in np.flatnonzero(report.fresh):
            wrong = self.master.gather.counts[self._arm.tactels_of(p)] != self.patches.own
            if wrong.any():
                self.violations.append((report.t_ns, int(p), int(wrong.sum())))

    def _thread(self, core, on_event):
        return threading.Thread(target=self._run, args=(core, on_event))

    def _run(self, core, on_event):
        try:
            bus = lambda: PythonCanBus("udp_multicast", self.group)  # noqa: E731
            run_core(core, bus, stop=self._stop, on_event=on_event)
        except BaseException as error:
            self.errors.append(error)
            raise


@pytest.fixture
def skin(tmp_path):
    with Skin(tmp_path, f"239.74.{os.getpid() >> 8 & 255}.{os.getpid() & 255}") as skin:
        yield skin


LATENESS = {
    "always late by more than a period": lambda tpdo: 1.3,
    "two TPDOs late": lambda tpdo: 1.3 if tpdo > 2 else 0.0,
    "one TPDO never": lambda tpdo: None if tpdo == 2 else 0.0,
    "late at random": lambda tpdo, rng=np.random.default_rng(5): rng.uniform(0.0, 2.0),  # noqa: B008
}


@pytest.mark.parametrize("kind", LATENESS)
def test_late_torn_and_missing_tpdos_are_never_fresh_are_named_and_come_back(skin, kind):
    late = LATENESS[kind]

    def delay(node_id, tpdo):
        periods = late(tpdo) if node_id == BAD else 0.0
        return None if periods is None else periods * skin.period_ns

    skin.patches.delay = delay
    skin.wait_for_event(EventKind.READINGS_LOST, BAD)
    share = skin.look().mean(0)
    print(kind, share)
    assert share[BAD - 1] <= (0.1 if kind == "late at random" else 0.0)
    skin.patches.delay = lambda node_id, tpdo: 0.0
    skin.wait_for_event(EventKind.PATCH_BACK, BAD)


def test_two_boards_under_one_node_id_are_named_and_not_used(skin):
    skin.patches.doubled = {BAD}
    skin.wait_for_event(EventKind.PATCH_DOUBLED, BAD)
    assert not skin.look()[:, BAD - 1].any()


class ForeignMaster(Core):
    """Sends SYNC at 70 Hz with a counter, until it is told to stop."""

    cob_ids = frozenset()
    is_on = True

    def step(self, now_ns, frames):
        return Step([Frame(cia.SYNC_ID, b"\1")] if self.is_on else [], (), now_ns + round(1e9 / 70))


def test_nothing_is_fresh_while_another_master_sends_sync(skin):
    foreign = ForeignMaster()
    skin.attach(foreign)
    skin.wait_for_event(EventKind.OTHER_MASTER)
    skin.wait_for(lambda: not skin.fresh[-1].any(), "that nothing is fresh")
    assert not skin.look().any()
    foreign.is_on = False
    skin.wait_for(lambda: skin.fresh[-1].all(), "fresh readings")


def test_mappings_that_another_tool_swaps_are_taken_back(skin):
    device = skin.patches.world.devices[BAD - 1]

    def mapped():
        return [device.get(cia.TPDO_MAPPING + k, 1) for k in range(2)]

    before = mapped()
    *writes, _ = swapped_mappings(device)  # all but storing it
    skin.attach(Tool(BAD, writes))
    skin.wait_for_event(EventKind.PATCH_FELL_BACK, BAD)
    skin.wait_for(lambda: mapped() == before and skin.fresh[-1].all(), "that it is repaired")


def test_boards_with_default_settings_report_no_error(skin):
    skin.look()
    assert EventKind.PATCH_EMCY not in skin.kinds()
    assert not skin.patches.world.devices[0].get(cia.ERROR_REGISTER)
