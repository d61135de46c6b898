"""Readings that are wrong in substance, on UDP multicast: no contact of them is published as true."""

import numpy as np
import pytest

from skinbus.can.event import EventKind
from skinbus.config.system import load_arm
from skinbus.estimate import Quality
from skinbus.master import Master
from skinbus.master.commissioning.configure import Configurer
from skinbus.master.commissioning.sessions import Timeouts
from skinbus.master.patches.provisioning import Provision, expected_node
from skinbus.objects.eds import load_eds
from skinbus.objects.settings import freeze
from tests.bus.boards_in_threads import BAD, GOOD, Skin, Threads, write_scene
from tests.cli.processes import process
from tests.master.commission import patch
from tests.master.misbehaving import Rebooting, SlowFlash
from tests.master.rig import Patches
from tests.own_bus import own_group

RATE_HZ = 50
FORCE_N = 10.0
NOISE_PA = 200.0
SEED = 31


class Readings:
    """What a board reads: noise, a zero (Pa) and a press of so many newtons, or what a test forces."""

    def __init__(self, arm, p):
        placed = arm.patches[p]
        d = arm.links[0].surface.distance(
            arm.tactel_s[arm.tactels_of(p)],
            arm.tactel_a[arm.tactels_of(p)],
            placed.s + 0.003,
            placed.a + 0.002,
        )
        self.of_newton = placed.patch.law.pressure(d, 1.0)
        self.step = placed.patch.transducer.resolution
        self.rng = np.random.default_rng(SEED + p)
        self.zero = self.force = 0.0
        self.forced = {}
        """Counts by tactel (from 0)."""
        self.is_frozen = False
        self._counts = np.zeros(16, int)

    def __call__(self, tpdo, counts):
        if tpdo == 0 and not self.is_frozen:
            pressures = self.zero + self.force * self.of_newton + NOISE_PA * self.rng.standard_normal(16)
            self._counts = np.rint(pressures / self.step).astype(int)
            for tactel, forced in list(self.forced.items()):
                self._counts[tactel] = forced
        return self._counts[4 * tpdo : 4 * tpdo + 4]


class NoisySkin(Skin):
    """A skin whose second board, ``bad``, a test presses and spoils."""

    def __init__(self, scene_file, group):
        super().__init__(scene_file, group, Patches)
        for p, node_id in enumerate((GOOD, BAD)):
            self.boards.changes[node_id] = Readings(self.arm, p)
        self.bad = self.boards.changes[BAD]

    def contacts(self, reports):
        """Contacts in some cycles that are published as true."""
        return [
            (report.t_ns, float(report.contacts.force[c]))
            for report in reports
            for c in range(len(report.contacts))
            if not report.contacts.quality[c] & Quality.IMPAIRED
        ]

    def begin(self):
        """Wait until the noise of the boards is known."""
        self.wait_for(lambda: len(self.reports) > 2.5 * RATE_HZ, "cycles")

    def press(self):
        """Press until there is a contact of the right force."""
        self.bad.force = FORCE_N

        def is_right():
            true = self.contacts(self.reports[-1:])
            return len(true) == 1 and abs(true[0][1] - FORCE_N) < 0.1 * FORCE_N

        self.wait_for(is_right, f"a contact of {FORCE_N} N")

    def spoil(self, what):
        """Do it; return the reports of SYNCs from then on until it is named."""
        n_events = len(self.events)
        what()
        n_reports = len(self.reports) + 1  # one cycle may be under way

        def named():
            return [
                event
                for event in self.events[n_events:]
                if event.kind == EventKind.TACTELS_IMPLAUSIBLE and event.node_id == BAD
            ]

        self.wait_for(named, "an event that names the tactels")
        named_ns = named()[0].t_ns
        return [report for report in self.reports[n_reports:] if report.t_ns < named_ns]

    def heal(self, undo):
        undo()
        self.wait_for_event(EventKind.TACTELS_IMPLAUSIBLE_END, BAD)


@pytest.fixture
def skin(tmp_path):
    with NoisySkin(write_scene(tmp_path, RATE_HZ), own_group()) as skin:
        yield skin


@pytest.mark.parametrize("counts", [-3000, -32768])
def test_a_board_that_warms_up_makes_no_contact_is_named_and_recovers_by_itself(tmp_path, counts):
    skin = NoisySkin(write_scene(tmp_path, RATE_HZ), own_group())
    skin.bad.forced = dict.fromkeys(range(16), counts)
    with skin:
        skin.wait_for_event(EventKind.TACTELS_IMPLAUSIBLE, BAD)
        skin.heal(skin.bad.forced.clear)
        skin.look()
        assert not skin.contacts(skin.reports)
        skin.press()


@pytest.mark.slow
def test_what_drift_explains_is_no_contact_after_a_touch(tmp_path):
    drift = '[patch.set]\n"Thresholds/Zero drift Pa" = 6000.0'
    with NoisySkin(write_scene(tmp_path, RATE_HZ, drift), own_group()) as skin:
        skin.begin()
        skin.press()
        for skin.bad.zero in np.linspace(0.0, 1500.0, 10):
            skin.look(0.2)
        skin.wait_for(lambda: skin.contacts(skin.reports[-1:]), "the touch, which goes on")
        skin.bad.force = 0.0
        skin.wait_for(lambda: not any(len(r.contacts) for r in skin.reports[-RATE_HZ // 2 :]), "a free skin")
        skin.press()


def test_readings_at_the_rail_are_no_contact_named_within_half_a_second_and_come_back(skin):
    skin.begin()
    skin.press()
    reports = skin.spoil(lambda: skin.bad.forced.update(dict.fromkeys(range(16), -32768)))
    assert sum(report.fresh[BAD - 1] for report in reports) <= 0.5 * RATE_HZ
    assert not skin.contacts(reports[2:])
    skin.bad.force = (
        0.0  # readings come back on a free board: zeros have followed the rail, and are found again
    )
    skin.heal(skin.bad.forced.clear)
    skin.press()


def test_bytes_frozen_in_a_press_are_withheld_named_within_a_second_and_come_back(skin):
    skin.begin()
    skin.press()
    reports = skin.spoil(lambda: setattr(skin.bad, "is_frozen", True))
    assert len(reports) <= RATE_HZ
    assert not any(report.fresh[BAD - 1] for report in reports[3:])
    assert any(report.fresh[GOOD - 1] for report in reports)
    assert not skin.contacts(reports[3:])
    skin.heal(lambda: setattr(skin.bad, "is_frozen", False))
    skin.press()


def test_a_tactel_stuck_at_full_scale_is_no_contact_and_named_within_half_a_second(skin):
    reports = skin.spoil(lambda: skin.bad.forced.update({5: 32752}))
    assert sum(report.fresh[BAD - 1] for report in reports) <= 0.5 * RATE_HZ
    assert not any(len(report.contacts) for report in reports)
    skin.bad.force = FORCE_N
    skin.wait_for(lambda: len(skin.reports[-1].contacts), "a contact beside it")
    assert not skin.contacts(skin.look()), "all of them say that a tactel is missing"
    skin.bad.force = 0.0
    skin.heal(skin.bad.forced.clear)


@pytest.mark.slow
def test_an_arm_with_readings_in_no_tpdo_is_refused_before_anything_is_sent(tmp_path):
    write_scene(tmp_path, RATE_HZ, '[patch.set]\n"0x1803:01" = 0xC0000481')
    place = ["--interface", "udp_multicast", "--channel", own_group()]
    said = process("run", str(tmp_path / "arm.toml"), *place)
    assert said.returncode == 2
    assert "4 of 16 readings in no enabled TPDO: 13, 14, 15, 16" in said.stderr


def test_a_board_that_reboots_after_each_start_backs_off():
    board, events = Rebooting(patch(1), after_ms=10), []
    with Threads(own_group()) as threads:
        threads.attach(board)  # who is started by the thread that takes the events
        threads.attach(Master(load_arm("pad")), lambda event: events.append((event.detail, board.n_starts)))
        threads.wait_for(lambda: any("in 2 s" in detail for detail, _ in events), "the second delay")
    k, n_starts = next((k, n) for k, (detail, n) in enumerate(events) if "in 2 s" in detail)
    assert n_starts == 3
    assert k < 6 * n_starts


def test_flash_that_takes_0_8_s_is_awaited():
    plan = expected_node(3, load_eds("skin-patch", 3, settings=freeze({"Touch Pa": 1500})))
    # A store is awaited as long as by default; a busy machine may need longer for the other answers.
    core, events = Configurer([plan], timeouts=Timeouts(sdo_ns=Timeouts().store_ns)), []
    with Threads(own_group()) as threads:
        threads.attach(SlowFlash(patch(3), delay_ms=800))
        threads.attach(core, events.append)
        threads.wait_for(lambda: 3 in core.results, "the result")
    assert core.results[3].outcome is Provision.CHANGED
