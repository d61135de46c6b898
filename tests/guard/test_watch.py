"""The guard on a virtual clock: what is a stop, what is none, and that a stop is for ever."""

import numpy as np
import pytest

from skinbus.can.event import EventKind
from skinbus.can.frame import ERROR, EXTENDED, RTR, Frame
from skinbus.guard.watch import Phase, region_forces
from skinbus.model.guard import GuardRegion, GuardSettings
from tests.guard.rig import (
    ARMED,
    ARMED_AND_TRIPPED,
    ARMS,
    GFC,
    IDLE,
    LOST,
    PERIOD,
    QUICK_STOP,
    TRIPPED,
    Rig,
)

BOTH = pytest.mark.parametrize("name", [*ARMS])


@BOTH
def test_it_guards_when_every_patch_is_armed_and_every_master_is_there(name):
    n = len(Rig(name).well())
    for left_out in range(n):
        rig = Rig(name)
        rig.step(*rig.well(left_out))
        assert rig.guard.phase is Phase.WAITING
        assert rig.events[-1].detail.count("silent") == 1
        rig.step(rig.well()[left_out])
        assert rig.count(EventKind.GUARDING) == 1
        assert not rig.is_stopped


@BOTH
def test_a_frame_of_liveness_may_be_lost_and_two_may_not(name):
    for k in range(len(ARMS[name].buses)):
        rig = Rig(name).guarding()
        rig.step(*rig.well(k), after=PERIOD)
        rig.step(*rig.well(), after=PERIOD + PERIOD // 4)  # late by the jitter of bus and machine
        for after in (PERIOD, PERIOD, LOST - 2 * PERIOD):
            assert not rig.is_stopped
            rig.step(*rig.well(k), after=after)
        assert not rig.is_stopped
        rig.step(*rig.well(k), after=1)
        assert rig.is_stopped
        assert rig.guard.reason == f"patch {rig.arm.node_label(int(rig.arm.bus_start[k]))} silent"


@pytest.mark.parametrize(
    ("state", "by", "reason"),
    [
        (TRIPPED, 7, "patch 1 tripped by tactel 7"),
        (ARMED_AND_TRIPPED, 0, "patch 1 tripped by the sum of its tactels"),
        (IDLE, 0, "patch 1 not armed"),
        (0x81, 0, "patch 1 not armed"),
    ],
)
def test_a_patch_that_is_not_exactly_armed_is_a_stop(state, by, reason):
    for n in (0, 1):  # somebody acknowledges in a loop, and the process takes both frames in one step
        rig = Rig().guarding()
        rig.step(rig.state(0, state, by), *[rig.state(0, ARMED)] * n)
        assert rig.is_stopped
        assert rig.guard.reason == reason


@BOTH
@pytest.mark.parametrize("data", [b"", b"\x00"])
def test_gfc_is_a_stop_on_any_bus_also_while_it_waits_and_before_what_came_with_it(name, data):
    for bus in range(len(ARMS[name].buses)):
        for rig in (Rig(name), Rig(name).guarding()):
            assert rig.step(rig.state(0, TRIPPED, 3), Frame(GFC, data, bus=bus)) == [QUICK_STOP]
            assert rig.is_stopped
            assert rig.guard.reason == "GFC"


def test_who_and_where_is_said_when_it_comes():
    rig = Rig().guarding()
    rig.step(Frame(GFC))
    rig.step(Frame(0x81, bytes.fromhex("02ff810510270000")), rig.state(0, TRIPPED, 5))
    told = [
        event.detail for event in rig.events if (event.kind, event.node_id) == (EventKind.GUARD_TRIPPED, 1)
    ]
    assert told == ["tactel 5 reads 10000 counts", "tripped by tactel 5"]


@pytest.mark.parametrize(
    "frame",
    [
        *[Frame(can_id, data) for can_id in (0x501, 0x77F) for data in (b"", b"\x02", bytes(3))],
        *[Frame(can_id, b"\x01\x00", 0, flag) for can_id in (GFC, 0x501) for flag in (EXTENDED, RTR, ERROR)],
        *[Frame(can_id, bytes(8)) for can_id in (0x000, 0x080, 0x081, 0x181, 0x502, 0x581, 0x664, 0x701)],
        *[Frame(0x5E4, data) for data in (b"", bytes(8), b"\xff" * 8, QUICK_STOP[1])],
        Frame(0x501, bytes(2), bus=1),
    ],
    ids=str,
)
def test_frames_that_are_not_for_it_change_nothing(frame):
    rig = Rig().guarding()
    rig.step(frame)
    assert not rig.is_stopped
    rig.step(frame, after=LOST + 1)  # and are no sign of life
    assert rig.is_stopped


def test_trips_from_before_are_taken_back_if_that_is_wished():
    for is_wished in (False, True):
        rig = Rig(acknowledges=is_wished)
        word = (0x601, bytes.fromhex("23802003") + b"ackn")
        assert rig.step(rig.state(0, TRIPPED, 1)) == [word] * is_wished


def test_a_contact_beyond_limit_times_factor_is_a_stop_at_once():
    rig = Rig().guarding()
    rig.press(19.9)
    assert not rig.is_stopped
    rig.press(20.1)
    assert rig.is_stopped
    assert rig.guard.reason == "contact of 20.1 N in region region, beyond 10 N for 20 ms"


@BOTH
def test_a_contact_beyond_the_limit_of_its_region_is_a_stop_when_it_lasts(name):
    rig = Rig(name).guarding()
    for force in (15.0, 15.0, 15.0, 15.0, 15.0, 15.0, 9.9) * 3:  # 100 ms are not longer than 100 ms
        rig.press(force, 10.0)
        assert not rig.is_stopped
    for _ in range(6):
        rig.press(10.0, 15.0) if rig.last_bus else rig.press(15.0)
    assert not rig.is_stopped
    rig.press(15.0, after=1)
    assert rig.is_stopped


def test_a_pressure_beyond_its_limit_is_a_stop_when_it_lasts_and_beyond_the_factor_at_once():
    """Patches compare with limit times factor alone."""
    for pa, n in ((45e3, 7), (61e3, 1)):
        rig = Rig().guarding()
        for _ in range(n):
            assert not rig.is_stopped
            rig.press(1.0, pa=pa)
        assert rig.is_stopped


def test_a_contact_is_in_the_regions_of_the_nearest_tactel_of_its_link():
    arm, rng = ARMS["arm-two-buses"], np.random.default_rng(3)
    regions = tuple(
        GuardRegion(name=f"{share}", tactels=rng.random(arm.n_tactels) < share) for share in (0.1, 0.5, 1.0)
    )
    for link, placed in enumerate(arm.links):
        own = np.flatnonzero(arm.tactel_link == link)
        for s, a in rng.uniform(-0.2, 0.4, (30, 2)):
            at = [float(placed.surface.distance(s, a, arm.tactel_s[i], arm.tactel_a[i])) for i in own]
            wanted = [5.0 * region.tactels[own[at.index(min(at))]] for region in regions]
            columns = np.array([[link] * 3, [s] * 3, [a] * 3, [np.nan, 5.0, 3.0]])
            assert region_forces(arm, GuardSettings(regions=regions), *columns) == wanted


@pytest.mark.parametrize("vanish", [False, True])
def test_stale_or_vanished_contacts_are_said_and_a_stop_only_where_they_are_wanted(vanish):
    for is_wanted in (False, True):
        rig = Rig(needs_contacts=is_wanted)
        rig.step(*rig.well())
        assert (rig.guard.phase is Phase.WAITING) == is_wanted
        rig.press(1.0)
        assert rig.guard.phase is Phase.GUARDING
        if vanish:
            rig.guard.contacts = None
        for _ in range(50):
            rig.step(*rig.well(), after=PERIOD)
        assert rig.is_stopped == is_wanted
        assert (
            rig.count(EventKind.CONTACTS_LOST) == 1 + is_wanted
        )  # before the first, too, where they are wanted
        assert rig.guard.reason == ("contacts silent" if is_wanted else "")


def test_stopped_is_for_ever_and_an_order_to_end_is_no_stop_while_it_waits():
    rig = Rig().guarding()
    rig.step(Frame(GFC))
    for _ in range(100):
        rig.step(rig.answer(), *rig.well(), after=PERIOD)
        assert rig.is_stopped
    rig = Rig()
    rig.guard.is_ending = True
    rig.step(*rig.well())
    assert not rig.is_stopped
    assert not rig.guard.last_frames(rig.now_ns)
