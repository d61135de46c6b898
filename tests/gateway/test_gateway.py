"""A skin that is not CANopen as patches of an arm: what it senses is published, what it loses is said."""

import numpy as np
import pytest

from skinbus.can.event import EventKind
from skinbus.can.virtual_buses import VirtualBuses
from skinbus.config.system import ods_of
from skinbus.errors import ArgumentError
from skinbus.gateway.frame_format import load_format
from skinbus.gateway.gateway import Gateway
from skinbus.master import Master
from tests.gateway.doubles import Double, write_scene
from tests.guard.rig import first_patches
from tests.master.rig import since

pytestmark = pytest.mark.slow

MS = 1_000_000
S_MM, A_MM, FORCE_N = 52.0, 1.0, 4.0
PRESS = f"""[[touch]]
link = "plate"
s_mm = {S_MM}
a_mm = {A_MM}
force_n = {FORCE_N}
start_s = 1.5
end_s = 900.0
"""
MTB4 = ("icub-mtb4", ["2.0", "2.1", "3.7"], 5, 2)
XELA = ("xela-uskin", ["1", "2", "3"], 4, 4)


class Rig:
    """A master, a gateway and the boards of a skin on two wires."""

    def __init__(self, folder, name, addresses, columns, rows):
        self.found = load_format(name)
        self.scene = write_scene(folder, addresses, columns, rows, touches=PRESS)
        arm = self.scene.arm
        self.boards = Double(self.found, arm, self.scene)
        self.gateway = Gateway(self.found, arm, ods_of(arm))
        self.reports, self.events, self.said = [], [], []
        self.master = Master(arm, on_cycle=self.reports.append)
        self.wires = VirtualBuses([arm.bus.bitrate, self.found.bitrate])
        self.wires.attach(self.gateway, on_event=self.said.append)
        self.wires.wires[0].attach(self.master, on_event=self.events.append)
        self.wires.wires[1].attach(self.boards)

    def run(self, ms):
        """Let time pass; return the cycles and the events of the master and of the gateway in that time."""
        until_ns = self.wires.clock.now_ns() + round(ms * MS)
        return since(lambda: self.wires.run(until_ns), self.reports, self.events, self.said)


def are_right(cycles):
    """Whether there is one contact in each of them, where the press is."""
    return all(
        len(contacts) == 1
        and np.hypot(contacts.s[0] - 1e-3 * S_MM, contacts.a[0] - 1e-3 * A_MM) < 0.5e-3
        and abs(contacts.force[0] - FORCE_N) < 0.15 * FORCE_N
        for contacts in (cycle.contacts for cycle in cycles)
    )


@pytest.mark.parametrize("skin", [MTB4, XELA], ids=["mtb4", "xela"])
def test_a_touch_of_the_skin_is_a_contact_of_the_master(tmp_path, skin):
    rig = Rig(tmp_path, *skin)
    cycles, events, said = rig.run(1400)
    assert not any(len(cycle.contacts) for cycle in cycles)
    cycles, more, more_said = rig.run(1000)
    # the force of the press rises for 100 ms
    assert are_right(cycle for cycle in cycles if cycle.contacts.t_ns > 1700 * MS)
    usual = {EventKind.NMT_STATE, EventKind.PATCH_STARTED}
    assert {event.kind for event in (*events, *more, *said, *more_said)} == usual
    # no board that sends is told to start again
    assert len(rig.boards.heard) == len(rig.found.commands(rig.found.start, skin[1]))


def marked(high, low):
    """Return what sets bits of the mask and the faults that a triangle sends."""

    def change(frames):
        data = frames[1].data
        return [frames[0], frames[1]._replace(data=data[:6] + bytes([data[6] | high, data[7] | low]))]

    return change


ALL_MASKED = marked(0xFF, 0xF0)
FAILURES = {
    "silent": lambda frames: [],
    "short": lambda frames: [frame._replace(data=frame.data[:5]) for frame in frames],
    "one part": lambda frames: frames[:1],
    "not connected": marked(0, 2),
    "all masked": ALL_MASKED,
    "another triangle": lambda frames: [frame._replace(can_id=frame.can_id ^ 0x8) for frame in frames],
}


def test_a_triangle_that_fails_is_lost_within_three_periods_and_alone(tmp_path):
    rig = Rig(tmp_path, *MTB4)
    rig.run(2000)
    for name, change in FAILURES.items():
        rig.boards.changes["2.1"] = change  # the pressed one
        _, events, said = rig.run(4 * 50)
        assert [event.kind for event in said] == [EventKind.READINGS_LOST] * (change is not ALL_MASKED), name
        assert any(event.kind is EventKind.PATCH_EMCY and event.node_id == 2 for event in events), name
        cycles, events, _ = rig.run(400)
        assert not any(len(cycle.contacts) for cycle in cycles), name
        assert not any(event.node_id in (1, 3) for event in events), name
        rig.boards.changes.clear()
        rig.run(1600)
        assert are_right(rig.run(200)[0]), name


def test_two_boards_with_one_address_are_named(tmp_path):
    rig = Rig(tmp_path, *MTB4)
    rig.run(2000)
    rig.boards.twice.add("2.1")
    _, events, said = rig.run(4 * 50)
    assert [(event.kind, event.node_id) for event in said] == [(EventKind.READINGS_LOST, 2)]
    assert "two boards" in said[0].detail
    assert any(event.kind is EventKind.PATCH_EMCY and event.node_id == 2 for event in events)


def test_a_mask_that_sticks_leaves_the_other_tactels(tmp_path):
    rig = Rig(tmp_path, *MTB4)
    rig.boards.changes["2.1"] = marked(0, 0x10)  # t0
    rig.run(2000)
    cycles, _, said = rig.run(400)
    assert are_right(cycles)
    assert not said


def test_boards_that_restart_are_started_again(tmp_path):
    rig = Rig(tmp_path, *MTB4)
    rig.run(2000)
    rig.boards.running.clear()
    rig.boards.heard.clear()
    rig.run(3000)
    assert rig.boards.running == {"2.0", "2.1", "3.7"}
    cycles, _, _ = rig.run(100)
    assert are_right(cycles)


def test_the_skin_is_told_to_stop_at_the_end(tmp_path):
    rig = Rig(tmp_path, *MTB4)
    assert [(f.can_id, f.data, f.bus) for f in rig.gateway.last_frames(5)] == [
        (0x202, b"\x07\x01", 1),
        (0x203, b"\x07\x01", 1),
    ]


@pytest.mark.parametrize(
    ("addresses", "columns", "bits", "message"),
    [
        (["2.0", "2.0"], 5, 9, "address '2.0' is that of node 1"),
        (["2.0", "2.16"], 5, 9, "node 2: address '2.16': wanted a triangle up to 15"),
        (["2.0"], 4, 9, "node 1: 8 tactels; wanted 10"),
        (["2.0"], 5, 8, "node 1: 8 bits; wanted 16"),
    ],
)
def test_an_arm_that_does_not_fit_the_format_is_refused(tmp_path, addresses, columns, bits, message):
    arm = write_scene(tmp_path, addresses, columns, 2, bits=bits).arm
    with pytest.raises(ArgumentError, match=message):
        Gateway(load_format("icub-mtb4"), arm, ods_of(arm))


def test_a_guarded_board_whose_eds_says_another_period_than_that_of_its_samples_is_refused(tmp_path):
    found, arm = load_format(MTB4[0]), first_patches(write_scene(tmp_path, *MTB4[1:]).arm, force=10.0)
    ods = ods_of(arm)
    with pytest.raises(ArgumentError, match=r"^node 1: samples every 50000 us; .* of its EDS says 1000$"):
        Gateway(found, arm, ods)
    ods[0][0x2080][4].default = 50_000
    Gateway(found, arm, ods)
