"""Boards that misbehave, on UDP multicast: what is used as fresh was sampled for its SYNC, faults are named.

Two boards in real time, of which the second misbehaves; a reading is the number of the SYNC that it answers.
How often boards are fresh, and how soon cycles end, is asserted on the virtual clock:
``tests/master/test_freshness.py``.
"""

import numpy as np
import pytest

from skinbus.can.core import Core, Step
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.objects import cia
from tests.bus.boards_in_threads import BAD, Skin, write_scene
from tests.master.misbehaving import Tool, swapped_mappings
from tests.master.misbehaving_rig import Misbehaving
from tests.own_bus import own_group


class CheckedSkin(Skin):
    """Every reading that is used as fresh must be the number of the newest SYNC."""

    def __init__(self, *args):
        self.violations = []
        super().__init__(*args)

    def __exit__(self, *exc):
        super().__exit__(*exc)
        assert not self.violations, self.violations[:10]

    def check(self, report):
        super().check(report)
        for p in np.flatnonzero(report.fresh):
            wrong = self.master.gather.counts[self.arm.tactels_of(p)] != self.boards.own
            if wrong.any():
                self.violations.append((report.t_ns, int(p), int(wrong.sum())))


@pytest.fixture
def skin(tmp_path):
    with CheckedSkin(write_scene(tmp_path, rate_hz=25), own_group(), Misbehaving) as skin:
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

    skin.boards.delay = delay
    skin.wait_for_event(EventKind.READINGS_LOST, BAD)
    fresh = skin.look_fresh()[:, BAD - 1]
    print(kind, fresh.mean())
    if kind == "one TPDO never":  # others are in time where a busy machine sends the next SYNC that late
        assert not fresh.any()
    skin.boards.delay = lambda node_id, tpdo: 0.0
    skin.wait_for_event(EventKind.PATCH_BACK, BAD)


def test_two_boards_under_one_node_id_are_named_and_not_used(skin):
    skin.boards.doubled = {BAD}
    skin.wait_for_event(EventKind.PATCH_DOUBLED, BAD)
    assert not skin.look_fresh()[:, BAD - 1].any()


class ForeignMaster(Core):
    """Sends SYNC at 70 Hz with a counter, until it is told to stop."""

    cob_ids = frozenset()
    is_on = True

    def step(self, now_ns, frames):
        return Step([Frame(cia.SYNC_ID, b"\1")] if self.is_on else [], (), now_ns + round(1e9 / 70))


@pytest.mark.slow
def test_nothing_is_fresh_while_another_master_sends_sync(skin):
    foreign = ForeignMaster()
    skin.attach(foreign)
    skin.wait_for_event(EventKind.OTHER_MASTER)
    skin.wait_for(lambda: not skin.reports[-1].fresh.any(), "that nothing is fresh")
    assert not skin.look_fresh().any()
    foreign.is_on = False
    skin.wait_for(lambda: skin.reports[-1].fresh.all(), "fresh readings")


def test_mappings_that_another_tool_swaps_are_taken_back(skin):
    device = skin.boards.world.devices[BAD - 1]

    def mapped():
        return [device.get(cia.TPDO_MAPPING + k, 1) for k in range(2)]

    before = mapped()
    *writes, _ = swapped_mappings(device)  # all but storing it
    skin.attach(Tool(BAD, writes))
    skin.wait_for_event(EventKind.PATCH_FELL_BACK, BAD)
    skin.wait_for(lambda: mapped() == before and skin.reports[-1].fresh.all(), "that it is repaired")


def test_a_heartbeat_that_another_tool_ends_is_taken_back(skin):
    device = skin.boards.world.devices[BAD - 1]
    before = device.get(cia.HEARTBEAT_PRODUCER)
    skin.attach(Tool(BAD, [(cia.HEARTBEAT_PRODUCER, 0, bytes(2))]))
    skin.wait_for_event(EventKind.PATCH_FELL_BACK, BAD)
    skin.wait_for(lambda: device.get(cia.HEARTBEAT_PRODUCER) == before, "that it is repaired")
    skin.wait_for(lambda: skin.reports[-1].fresh.all(), "fresh readings")


def test_boards_with_default_settings_report_no_error(skin):
    skin.look_fresh()
    assert EventKind.PATCH_EMCY not in skin.kinds()
    assert not skin.boards.world.devices[0].get(cia.ERROR_REGISTER)
