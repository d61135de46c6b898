"""The guard as the master sets it: limits in counts are those of the arm file, are there before a patch
starts, follow its zeros, and it is said when they do not."""

import numpy as np
import pytest

from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm, ods_of
from skinbus.master import Master
from skinbus.master.guarding import DIFFERENT, Guarding
from skinbus.master.patches.table import PatchState, PatchTable
from skinbus.objects.cia import EmcyCode
from skinbus.objects.guard import GuardLimits
from tests.files import put
from tests.master.rig import Rig

pytestmark = pytest.mark.slow

DEAD = 5
"""Tactel of the second board."""
rng = np.random.default_rng(1)
OFFSETS = {16: rng.integers(-400, 400, 16).tolist(), 8: rng.integers(-3, 3, 16).tolist()}
ARM = f"""
[arm]
name = "guarded"
rate_hz = 20
[[link]]
name = "plate"
surface = "plane"
length_mm = 250
width_mm = 60
[[patch]]
node_id = 1
link = "plate"
s_mm = 30
set = {{ "Tactel gain" = {rng.uniform(0.8, 1.2, 16).round(3).tolist()}, "Tactel offset" = {OFFSETS[16]} }}
[[patch]]
node_id = 2
link = "plate"
s_mm = 82
eds = "skin-patch-8bit"
[patch.set]
"Healthy tactels" = {0xFFFF & ~(1 << DEAD)}
"Tactel gain" = {rng.uniform(0.8, 1.2, 16).round(3).tolist()}
"Tactel offset" = {OFFSETS[8]}
[[patch]]
node_id = 3
link = "plate"
s_mm = 200
[guard]
samples = [2, 3]
liveness_ms = 30
[[guard.region]]
name = "both boards"
link = "plate"
s_mm = [0, 120]
force_n = 60
pressure_kpa = 35
transient_factor = 2
source = "a test"
"""
SECOND = """
[[guard.region]]
name = "part of the first board"
patches = [1]
link = "plate"
s_mm = [0, 30]
force_n = 20
pressure_kpa = 30
source = "a test"
"""
SCENE = """
[scene]
title = "guarded"
arm = "arm.toml"
duration_s = 1000
[[touch]]
link = "plate"
s_mm = 30
a_mm = 0
force_n = 2
start_s = 5
end_s = 1000
"""


def guarding_of(folder, text, zeros):
    """The guarding of an arm with these zeros, the arm, and the areas of its tactels."""
    arm = load_arm(put(folder, "arm.toml", text))
    cycle = Master(arm).cycle
    cycle.baseline.felt.zero[:] = zeros
    return Guarding(cycle, slice(0, 3), ods_of(arm), PatchTable(arm.n_patches)), arm, cycle.areas


def is_beyond(limits, readings):
    """What a patch decides of samples (n, n_tactels)."""
    return (readings > limits.limits).any(axis=1) | (
        np.maximum(readings - limits.rest, 0) @ limits.weights > limits.sum_limit
    )


@pytest.mark.parametrize("second", ["", SECOND])
def test_counts_exceed_limits_where_pressures_and_forces_do(tmp_path, second):
    zeros = rng.uniform(-900.0, 900.0, 48)
    guarding, arm, areas = guarding_of(tmp_path, ARM + second, zeros)
    boards = arm.tactel_patch < 2
    # force and pressure limit, and the tactels of each region
    regions = [(120.0, 70e3, boards), (20.0, 30e3, (arm.tactel_patch == 0) & (arm.tactel_s <= 0.030))]
    for p in range(3):
        here, board = arm.tactels_of(p), arm.patches[p].patch
        scale, zero = board.transducer.step * board.gain, zeros[here]
        # from one tactel that is pressed to a whole board
        pressed = rng.uniform(0.0, 1.0, (4000, 16)) ** rng.uniform(0.2, 20.0, (4000, 1))
        counts = np.rint((rng.uniform(0.0, 1.2e5, (4000, 1)) * pressed + zero) / scale + board.offset)
        counts = np.minimum(counts, board.transducer.top_counts)
        felt = ((counts - board.offset) * scale - zero) * arm.tactel_healthy[here]
        total, peak = np.zeros((4000, 16)), np.zeros(4000)
        for force, pressure, inside in regions[: 1 + bool(second)]:
            peak = np.maximum(peak, (felt * inside[here]).max(axis=1) / pressure)
            # regions share the sum of a patch, so that both together may exceed it
            total = np.maximum(total, areas[here] * felt * inside[here] / force)
        rounding = 0.5 / 511 / 100 * np.abs(counts - board.offset).sum(axis=1)
        clear = (np.abs(total.sum(axis=1) - 1.0) > rounding) & (np.abs(peak - 1.0) > 1e-9)
        wanted = (total.sum(axis=1) > 1.0) | (peak > 1.0)
        np.testing.assert_array_equal(is_beyond(guarding.limits(p), counts)[clear], wanted[clear])
        assert (300 < wanted[clear].sum() < 3700) == (p < 2)


def test_limits_that_zeros_move_beyond_full_scale_are_full_scale(tmp_path):
    text = ARM.replace("pressure_kpa = 35\ntransient_factor = 2", "pressure_kpa = 75")
    guarding, _, _ = guarding_of(tmp_path, text, 200e3)
    for p, full in ((0, 0x7FF0), (1, 0x7F)):
        limits, readings = guarding.limits(p), np.full((1, 16), full)
        assert ((limits.limits < full) == (limits.weights > 0)).all()
        assert is_beyond(limits, readings)


def test_a_tactel_at_full_scale_is_beyond_a_limit_of_force(tmp_path):
    """A tip that presses with 60 N on one tactel reads no more than one with 30 N."""
    text = ARM.replace("pressure_kpa = 35\ntransient_factor = 2\n", "")
    guarding, _, _ = guarding_of(tmp_path, text, 0.0)
    for p, full in ((0, 0x7FF0), (1, 0x7F)):
        pressed = np.outer([full, 0.99 * full], np.arange(16) == 3)
        assert is_beyond(guarding.limits(p), pressed).tolist() == [True, False]


@pytest.fixture
def rig(tmp_path):
    put(tmp_path, "arm.toml", ARM)
    return Rig(put(tmp_path, "scene.toml", SCENE), level="kmeans")


def held(rig, node_id):
    return rig.device(node_id).get(0x2081, 0) or None


def news(rig, ms):
    """Let bus time pass; return what is said of the guard."""
    kinds = EventKind.NOT_GUARDING, EventKind.NOT_GUARDING_END
    return [event.detail for event in rig.run(ms)[1] if event.kind in kinds]


def test_limits_are_there_from_the_first_zero_of_a_patch_on_and_then_before_it_starts(rig, tmp_path):
    wanted = guarding_of(tmp_path, ARM, 0.0)[0]
    held_by = {1: wanted.limits(0).encode(), 2: wanted.limits(1).encode(), 3: None}
    for limits in (dict.fromkeys(held_by), held_by):
        started = {}
        rig.say(*(Frame(0, bytes([0x81, node_id])) for node_id in held_by))
        while len(started) < 3:
            for frame in rig.run(1)[2]:
                if frame.can_id == 0 and frame.data[0] == 1:
                    started[frame.data[1]] = held(rig, frame.data[1])
        assert started == limits
        rig.run(3000)
    for node_id, is_on in ((1, True), (2, True), (3, False)):
        cob_id, timer = (rig.device(node_id).get(0x1808, sub) for sub in (1, 5))
        assert (cob_id >> 31 == 0, timer) == (is_on, 30 * is_on)
        assert held(rig, node_id) == held_by[node_id]
    raised, cleared, *_ = (frame.data for frame in rig.frames if frame.can_id == 0xFF)
    assert (raised[:2], raised[3:5]) == (EmcyCode.NOT_GUARDING.to_bytes(2, "little"), bytes([1, 2]))
    assert cleared[:2] == bytes(2)


def test_limits_follow_zeros_unless_the_patch_is_touched(rig):
    assert news(rig, 2500) == ["patches 1, 2", ""]
    first = held(rig, 1)
    # of the sum, 160 counts on all tactels are 3 N of 120
    rig.patches.added_counts = {1: 160}
    rig.run(500)
    assert held(rig, 1) == first  # so far they press
    rig.master.cycle.baseline.zero(0)
    assert news(rig, 1500) == []
    second = held(rig, 1)
    was, now = (GuardLimits.decode(data, 16) for data in (first, second))
    moved = now.limits - was.limits
    np.testing.assert_allclose(moved, 160, atol=1)
    # the sum moves by the load of what the tactels have drifted
    total = [limits.sum_limit + limits.weights @ limits.rest for limits in (was, now)]
    np.testing.assert_allclose(total[1] - total[0], now.weights @ moved, rtol=0.01)
    rig.run(1000)  # the touch begins
    rig.master.cycle.baseline.felt.zero[0] += 1.1 * DIFFERENT * 70e3
    assert news(rig, 2000) == ["patches 1"]
    assert held(rig, 1) is None  # by none it is not armed
    rig.master.cycle.baseline.felt.zero[0] -= 1.1 * DIFFERENT * 70e3
    assert news(rig, 2000) == [""]
    assert held(rig, 1)


def test_patches_that_are_lost_or_have_implausible_tactels_do_not_guard(rig):
    rig.run(2500)
    rig.patches.changes = {1: lambda tpdo, counts: np.where(tpdo == 0, -0x8000, counts)}
    assert news(rig, 1500) == ["patches 1"]
    assert (held(rig, 1), rig.device(1).get(0x2080, 1)) == (None, 0)
    rig.patches.unplugged.add(2)
    assert news(rig, 4000) == ["patches 1, 2"]


def test_a_patch_that_does_not_hold_its_limits_is_not_started(rig):
    passed_on = rig.patches.shifted

    def forgotten(frame):
        """A bit of what patch 1 reads in segments is not as it was written."""
        if frame.can_id != 0x581 or frame.data[0] >> 5:
            return passed_on(frame)
        return frame._replace(data=frame.data[:3] + bytes([frame.data[3] ^ 1]) + frame.data[4:])

    rig.patches.shifted = forgotten
    assert news(rig, 3000)[-1] == "patches 1"
    assert (rig.state(1), rig.state(2)) == (PatchState.WRONG, PatchState.OPERATIONAL)
    refused = [event.detail for event in rig.events if event.kind is EventKind.PATCH_REFUSED]
    assert refused == ["guard limits: others are read than were written"]
    rig.patches.shifted = passed_on
    assert news(rig, 3000) == [""]
    assert rig.state(1) == PatchState.OPERATIONAL


def test_limits_are_written_anew_when_somebody_may_have_written_unheard(rig):
    rig.run(3000)
    first = held(rig, 1)
    rig.patches.is_cut = True
    rig.device(1).set(
        0x2081, 0, GuardLimits(1, 1, 2**31 - 1, np.full(16, 32767), *np.ones((2, 16), int)).encode()
    )
    rig.run(100)
    rig.patches.is_cut = False
    for kind in (EventKind.BUS_LOST, EventKind.BUS_BACK):
        rig.master.bus_news(rig.wire.now_ns, Event(t_ns=rig.wire.now_ns, kind=kind))
    assert news(rig, 3000) == ["patches 1, 2", ""]
    assert held(rig, 1) == first


def test_an_arm_without_limits_boots_and_runs_without_a_word_of_the_guard():
    _, events, frames = Rig("pad").run(1500)
    assert not [event for event in events if "guard" in event.kind]
    asked = {frame.data[1:3] for frame in frames if frame.can_id == 0x601}
    assert asked.isdisjoint({bytes.fromhex("8120"), bytes.fromhex("8020"), bytes.fromhex("0818")})
    assert not [frame for frame in frames if frame.can_id == 1 or 0x500 < frame.can_id < 0x580]
