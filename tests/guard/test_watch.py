"""The guard on a virtual clock: what is a stop, what is none, and that a stop is for ever."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbus.can.event import Event, EventKind
from skinbus.can.frame import ERROR, EXTENDED, RTR, Frame
from skinbus.guard.watch import Phase, SeenContacts, regions_of
from skinbus.model.guard import GuardRegion, GuardSettings
from tests.guard.rig import (
    ARMED,
    ARMED_AND_TRIPPED,
    ARMS,
    DRIVE,
    GFC,
    IDLE,
    LOST,
    MASTER,
    MS,
    PERIOD,
    TRIPPED,
    Rig,
    is_stop,
    quick_stop,
    whole,
)

BOTH = pytest.mark.parametrize("name", [*ARMS])


@BOTH
def test_it_guards_when_every_patch_is_armed_and_every_master_is_there(name):
    rig = Rig(name)
    needed = rig.well()
    for left_out in range(len(needed)):
        rig = Rig(name)
        rig.step(*needed[:left_out], *needed[left_out + 1 :])
        assert rig.guard.phase is Phase.WAITING
        assert len(rig.guard.waits_for(rig.now_ns)) == 1
    rig.step(needed[-1])
    assert rig.kinds()[-1] is EventKind.GUARDING
    assert not is_stop(rig)


@BOTH
def test_a_frame_of_liveness_may_be_lost_and_two_may_not(name):
    for k in range(len(Rig(name).patches)):
        rig = Rig(name).guarding()
        others = [frame for frame in rig.well() if frame.can_id != rig.patches[k].cob_id]
        others += [rig.state(patch, ARMED) for patch in rig.patches if patch is not rig.patches[k]]
        rig.step(*others, after=PERIOD)
        rig.step(*rig.well(), after=PERIOD + PERIOD // 4)  # and late by the jitter of bus and machine
        assert not is_stop(rig)
        rig.step(*others, after=PERIOD)
        rig.step(*others, after=PERIOD)
        assert not is_stop(rig)
        rig.step(*others, after=LOST - 2 * PERIOD)
        assert not is_stop(rig)
        rig.step(*others, after=1)
        assert is_stop(rig)
        assert rig.guard.reason == f"patch {rig.patches[k].label}: silent for 50 ms"


@pytest.mark.parametrize(
    ("state", "by", "reason"),
    [
        (TRIPPED, 7, "patch 0: tripped by tactel 7"),
        (ARMED_AND_TRIPPED, 0, "patch 0: tripped by the sum of its tactels"),
        (IDLE, 0, "patch 0: not armed"),
        (0x81, 0, "patch 0: not armed"),
    ],
)
def test_a_patch_that_is_not_exactly_armed_is_a_stop(state, by, reason):
    rig = Rig().guarding()
    rig.step(rig.state(rig.patches[0], state, by))
    assert is_stop(rig)
    assert rig.guard.reason == reason


@BOTH
def test_gfc_on_any_bus_is_a_stop_before_anything_that_came_with_it_even_if_it_waits(name):
    for bus in range(len(ARMS[name].buses)):
        for rig in (Rig(name), Rig(name).guarding()):
            sent = rig.step(rig.state(rig.patches[0], TRIPPED, 3), Frame(GFC, bus=bus))
            assert rig.guard.reason.startswith("GFC")
            assert sent[0][:2] == quick_stop()[:2]
            assert is_stop(rig)


def test_who_and_where_is_said_when_it_comes():
    rig = Rig().guarding()
    node_id = rig.patches[0].node_id
    rig.step(Frame(GFC))
    rig.step(Frame(0x80 + node_id, bytes.fromhex("00ff810510270000")), rig.state(rig.patches[0], TRIPPED, 5))
    told = {event.kind: (event.node_id, event.detail) for event in rig.events}
    assert told[EventKind.GUARD_TRIPPED] == (node_id, "tripped by tactel 5")
    assert told[EventKind.PATCH_EMCY][0] == node_id


@BOTH
def test_a_master_without_heartbeat_is_a_stop(name):
    for bus in range(len(ARMS[name].buses)):
        rig = Rig(name).guarding()
        end_ns = rig.now_ns + MASTER * 5 // 2
        while rig.now_ns + PERIOD <= end_ns:
            rig.step(*[f for f in rig.well() if (f.can_id, f.bus) != (0x77F, bus)], after=PERIOD)
            assert not is_stop(rig)
        rig.step(*[f for f in rig.well() if (f.can_id, f.bus) != (0x77F, bus)], after=PERIOD)
        assert is_stop(rig)
        assert rig.guard.reason.startswith("master")


def test_a_master_that_only_boots_is_no_sign_of_life():
    rig = Rig()
    rig.step(*rig.well()[:1], Frame(0x77F, b"\x00"))
    assert rig.guard.phase is Phase.WAITING


@BOTH
def test_a_lost_bus_is_a_stop_at_once(name):
    rig = Rig(name)
    rig.guard.bus_news(rig.now_ns, Event(t_ns=rig.now_ns, kind=EventKind.BUS_LOST))
    rig.guarding()
    rig.guard.bus_news(rig.now_ns, Event(t_ns=rig.now_ns, kind=EventKind.BUS_LOST, detail="unplugged"))
    rig.step()
    assert is_stop(rig)
    assert rig.guard.reason.endswith("lost: unplugged")


def test_an_order_to_end_stops_what_is_guarded_and_nothing_else():
    rig = Rig()
    rig.guard.end("SIGTERM")
    rig.step(*rig.well())
    assert not is_stop(rig)
    rig = Rig().guarding()
    rig.guard.end("SIGTERM")
    rig.step()
    assert is_stop(rig)
    assert rig.guard.reason == "SIGTERM"


def test_a_process_that_ends_by_a_fault_stops_what_it_guards():
    assert not Rig().guard.last_frames(0)
    rig = Rig().guarding()
    assert [frame[:2] for frame in rig.guard.last_frames(rig.now_ns)] == [quick_stop()[:2]]


STRANGE = [
    *[Frame(can_id, data) for can_id in (0x501, 0x77F) for data in (b"", b"\x02", b"\x00\x00\x00")],
    *[Frame(can_id, bytes(2), flags=flags) for can_id in (GFC, 0x501) for flags in (EXTENDED, RTR, ERROR)],
    *[Frame(can_id, bytes(8)) for can_id in (0x000, 0x080, 0x081, 0x181, 0x502, 0x581, 0x600 + DRIVE, 0x701)],
    *[Frame(0x580 + DRIVE, data) for data in (b"", bytes(8), b"\xff" * 8)],
    Frame(0x501, b"\x00\x00", bus=1),
]


@pytest.mark.parametrize("frame", STRANGE, ids=str)
def test_frames_that_are_not_for_it_change_nothing(frame):
    rig = Rig().guarding()
    rig.step(frame)
    assert not is_stop(rig)
    rig.step(frame, after=LOST + 1)  # and is no sign of life
    assert is_stop(rig)


def test_what_it_hears_is_what_it_needs():
    rig = Rig("arm-two-buses", acknowledge=(0x2080, 3, b"ackn"))
    for bus, patch in enumerate(rig.patches):
        ids = {GFC, patch.cob_id, 0x80 + patch.node_id, 0x77F, 0x580 + patch.node_id}
        assert rig.guard.cob_ids_on(bus) == ids | ({0x580 + DRIVE} if bus == rig.stop.bus else set())


def test_only_patches_that_had_tripped_before_are_acknowledged_and_once():
    rig = Rig(acknowledge=(0x2080, 3, b"ackn"))
    tripped = rig.state(rig.patches[0], TRIPPED, 1)
    request = (0x600 + rig.patches[0].node_id, bytes.fromhex("23802003") + b"ackn")
    assert [frame[:2] for frame in rig.step(tripped)] == [request]
    assert not rig.step(tripped)
    rig.guarding()
    assert request not in [frame[:2] for frame in rig.step(tripped)]
    assert is_stop(rig)


def test_without_the_wish_nothing_is_acknowledged():
    rig = Rig()
    assert not rig.step(rig.state(rig.patches[0], TRIPPED, 1))


# Contacts


def contacts_rig(**settings):
    return Rig(regions=[whole(ARMS["pad"])], **settings).guarding()


def test_a_contact_beyond_limit_times_factor_is_a_stop_at_once():
    rig = contacts_rig()
    rig.press(19.9)
    assert not is_stop(rig)
    rig.press(20.1)
    assert is_stop(rig)
    assert rig.guard.reason.startswith("contact of 20.1 N in region all, beyond 10 N")


def test_a_contact_beyond_the_limit_is_a_stop_when_it_lasts():
    rig = contacts_rig()
    for _ in range(3):
        for _ in range(6):  # 100 ms are not longer than 100 ms
            rig.press(15.0)
        rig.press(9.9)
        assert not is_stop(rig)
    for _ in range(6):
        rig.press(15.0)
    rig.press(15.0, after=1)
    assert is_stop(rig)


@pytest.mark.parametrize("force", [np.nan, -np.inf, 0.0, 10.0])
def test_a_contact_within_the_limit_or_without_a_force_is_none_and_hides_none(force):
    rig = contacts_rig()
    for _ in range(20):
        rig.press(force)
    assert not is_stop(rig)
    two = [np.array([value, value]) for value in (0, rig.arm.tactel_s[0], rig.arm.tactel_a[0])]
    rig.guard.contacts = SeenContacts(rig.now_ns + 1, *two, np.array([force, 30.0]))
    rig.step(*rig.well(), after=1)
    assert is_stop(rig)


def test_a_contact_is_in_the_regions_of_the_nearest_tactel_of_its_link():
    arm, rng = ARMS["arm-two-buses"], np.random.default_rng(3)
    regions = [
        GuardRegion(name=str(k), tactels=rng.random(arm.n_tactels) < share, source="a test")
        for k, share in enumerate((0.1, 0.5, 1.0))
    ]
    link = rng.integers(0, len(arm.links) + 1, 200)
    s, a = rng.uniform(-0.1, 0.4, 200), rng.uniform(-0.3, 0.3, 200)
    found = regions_of(arm, GuardSettings(regions=tuple(regions)), SeenContacts(0, link, s, a, s))
    for k in range(200):
        own = [i for i in range(arm.n_tactels) if arm.tactel_link[i] == link[k]]
        surface = arm.links[min(link[k], len(arm.links) - 1)].surface
        at = [surface.distance(s[k], a[k], arm.tactel_s[i], arm.tactel_a[i]) for i in own]
        for region, inside in zip(regions, found, strict=True):
            assert inside[k] == (bool(own) and region.tactels[own[int(np.argmin(at))]])


def test_stale_or_vanished_contacts_are_said_and_no_stop_unless_they_are_wanted():
    for is_wanted in (False, True):
        for vanish in (False, True):
            rig = Rig(regions=[whole(ARMS["pad"])], needs_contacts=is_wanted)
            rig.step(*rig.well())
            assert (rig.guard.phase is Phase.WAITING) == is_wanted
            rig.press(1.0)
            assert rig.guard.phase is Phase.GUARDING
            if vanish:
                rig.guard.contacts = None
            for _ in range(50):
                rig.step(*rig.well(), after=PERIOD)
            assert is_stop(rig) == is_wanted
            assert rig.kinds().count(EventKind.CONTACTS_LOST) == 2  # the first before there were any
            if is_wanted:
                assert rig.guard.reason == "contacts"


# For ever

STEPS = st.lists(
    st.tuples(
        st.sampled_from(
            ["well"] * 9 + ["tripped", "idle", "gfc", "silence", "press", "answer", "abort", "bus", "end"]
        ),
        st.integers(1, 60 * MS),
    ),
    max_size=60,
)


@settings(max_examples=200, deadline=None)
@given(STEPS, st.sampled_from([*ARMS]))
def test_stopped_is_for_ever_and_only_what_is_well_is_guarded(steps, name):
    rig = Rig(name, regions=[whole(ARMS[name])])
    phases, reason = [rig.guard.phase], ""
    armed_ns, master_ns, told_ns = -(10**12), -(10**12), None
    for what, after in steps:
        rig.now_ns += after
        frames = {
            "well": rig.well(),
            "tripped": [rig.state(rig.patches[-1], TRIPPED, 1)],
            "idle": [rig.state(rig.patches[-1], IDLE)],
            "gfc": [Frame(GFC, bus=rig.guard.n_buses - 1)],
            "answer": [rig.answer()],
            "abort": [rig.answer()._replace(data=b"\x80\x40\x60\x00\x00\x00\x02\x06")],
        }.get(what, [])
        if what == "bus":
            rig.guard.bus_news(rig.now_ns, Event(t_ns=rig.now_ns, kind=EventKind.BUS_LOST))
        if what == "end":
            rig.guard.end("the end")
        if what == "press":
            rig.press(25.0, after=0)
        else:
            rig.step(*frames)
        if what in ("well", "press"):
            armed_ns = master_ns = rig.now_ns
        phases.append(rig.guard.phase)
        if rig.guard.phase is Phase.GUARDING:
            assert rig.now_ns - armed_ns <= LOST
            assert rig.now_ns - master_ns <= MASTER * 5 // 2
            assert what not in ("tripped", "idle", "gfc", "bus", "end", "press")
        if what == "gfc":
            assert rig.guard.phase is Phase.STOPPED
        if rig.guard.phase is Phase.STOPPED:
            reason = reason or rig.guard.reason
            assert rig.guard.reason == reason != ""
            if any((f.can_id, f.data, f.bus) == quick_stop(rig.stop.bus) for f in rig.sent):
                told_ns = rig.now_ns
                rig.sent.clear()
            assert told_ns is not None
            # at the latest a second after it was confirmed, and one step, it is told again
            assert rig.now_ns - told_ns <= 1000 * MS + 60 * MS
    order = [Phase.WAITING, Phase.GUARDING, Phase.STOPPED]
    ranks = [order.index(phase) for phase in phases]
    assert ranks == sorted(ranks)
    assert rig.kinds().count(EventKind.GUARD_STOP) == (ranks[-1] == 2)
