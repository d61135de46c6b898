"""The guard as the master sets it: limits in counts are those of the arm file, are there before a patch
starts, follow its zeros, and it is said when they do not."""

import numpy as np
import pytest

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm, ods_of
from skinbus.estimate import Baseline, LoadMeter, Plausibility
from skinbus.master.commissioning.sessions import Reply, Request
from skinbus.master.guarding import DIFFERENT, FOLLOWED, Guarding
from skinbus.master.patches.table import PatchState, PatchTable
from skinbus.node.device import Device
from skinbus.objects.cia import EmcyCode
from skinbus.objects.eds import load_eds
from skinbus.objects.guard import NO_LIMIT, GuardLimits
from tests.master.rig import Rig

LIMITS, LIVENESS = 0x2081, 0x1808
DEAD = 5
"""Tactel of the second board."""
rng = np.random.default_rng(1)
OFFSETS = {16: rng.integers(-400, 400, 16).tolist(), 8: rng.integers(-3, 3, 16).tolist()}
ARM = f"""
[arm]
name = "guarded"
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
start_s = 70
end_s = 1000
"""


class Bench:
    """A ``Guarding`` and what it looks at."""

    def __init__(self, folder, text=ARM):
        (folder / "arm.toml").write_text(text)
        self.arm = arm = load_arm(folder / "arm.toml")
        self.areas, self.table = LoadMeter(arm).areas, PatchTable(arm.n_patches)
        self.baseline, self.plausibility = Baseline(arm), Plausibility(arm)
        self.device = Device(load_eds("skin-master", 127), 127)
        self.guarding = Guarding(
            arm, slice(0, 3), ods_of(arm), self.areas, self.table, self.baseline, self.plausibility
        )

    def shown(self, s):
        """What is said of the guard at a time."""
        return news(self.guarding.show(round(s * 1e9), self.device))

    @property
    def due(self):
        return self.guarding.due()

    def write(self, p):
        """Let a patch take its limits; return what was written."""
        script = self.guarding.write(p)
        request = next(script)
        assert script.send(Reply()) == Request(request.index, request.sub)
        with pytest.raises(StopIteration):
            script.send(Reply(request.data))
        return request.data

    def run(self):
        """Let all patches run, with their limits, from 0 to 2 s."""
        self.table.state[:] = PatchState.OPERATIONAL
        assert self.shown(0) == [(EventKind.NOT_GUARDING, "patches 1, 2")]
        for p in (0, 1):
            assert self.write(p) == self.guarding.limits(p).encode()
        assert self.shown(2) == [(EventKind.NOT_GUARDING_END, "")]
        assert self.due is None


def is_beyond(limits, readings):
    """What a patch decides of one sample."""
    return bool((readings > limits.limits).any() or limits.weights @ readings > limits.sum_limit)


@pytest.mark.parametrize("second", ["", SECOND])
def test_counts_exceed_limits_where_pressures_and_forces_do(tmp_path, second):
    bench = Bench(tmp_path, ARM + second)
    arm, guarding, baseline, areas = bench.arm, bench.guarding, bench.baseline, bench.areas
    baseline.felt.zero[:] = rng.uniform(-900.0, 900.0, arm.n_tactels)
    decided = {True: 0, False: 0}
    for p in (0, 1):
        here, board = arm.tactels_of(p), arm.patches[p].patch
        limits, step, healthy = guarding.limits(p), board.transducer.step, arm.tactel_healthy[here]
        s = arm.tactel_s[here]
        # force and pressure limit and the tactels of each region
        regions = [(120.0, 70e3, healthy), (20.0, 30e3, healthy & (s <= 0.030))][
            : 2 if second and p == 0 else 1
        ]
        for _ in range(4000):
            # from one tactel that is pressed to a whole board
            pressure = rng.uniform(0.0, 100e3) * rng.uniform(0.0, 1.0, 16) ** rng.uniform(0.2, 20.0)
            readings = np.rint((pressure + baseline.felt.zero[here]) / (step * board.gain) + board.offset)
            readings = np.clip(readings, -board.transducer.full_counts, board.transducer.top_counts)
            felt = (readings - board.offset) * step * board.gain - baseline.felt.zero[here]
            forces = [(areas[here] * felt)[own].sum() / force for force, _, own in regions]
            peaks = [felt[own].max() / most for _, most, own in regions]
            # regions share the sum of a patch, so that both together may exceed it
            total = np.max([areas[here] * felt * own / force for force, _, own in regions], axis=0).sum()
            rounding = 0.5 * np.abs(readings - board.offset).sum() / 1023 / 100
            near = abs(total - 1.0) < rounding or min(abs(np.array(peaks) - 1.0)) < 1e-9
            if near:
                continue
            beyond = is_beyond(limits, readings)
            assert beyond == (total > 1.0 or max(peaks) > 1.0)
            assert beyond or max(forces) <= 1.0
            decided[beyond] += 1
    assert min(decided.values()) > 500


def test_what_is_not_guarded_has_no_limit(tmp_path):
    guarding = Bench(tmp_path).guarding
    limits = guarding.limits(1)
    assert (limits.n, limits.m) == (2, 3)
    assert (limits.weights[DEAD], limits.limits[DEAD]) == (0, NO_LIMIT)
    assert (np.delete(limits.weights, DEAD) > 0).all()
    unguarded = guarding.limits(2)
    assert (unguarded.limits == NO_LIMIT).all()
    assert not unguarded.weights.any()


def test_limits_that_zeros_move_beyond_full_scale_are_full_scale(tmp_path):
    text = ARM.replace("pressure_kpa = 35\ntransient_factor = 2", "pressure_kpa = 75")
    bench = Bench(tmp_path, text)
    bench.baseline.felt.zero[:] = 200e3
    for p, full in ((0, 0x7FF0), (1, 0x7F)):
        limits = bench.guarding.limits(p)
        healthy = limits.limits != NO_LIMIT
        assert (limits.limits[healthy] < full).all()
        assert is_beyond(limits, np.full(16, full))
        assert limits.weights @ np.full(16, full) > limits.sum_limit


@pytest.fixture
def files(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def news(events):
    """What was said of the guard."""
    kinds = EventKind.NOT_GUARDING, EventKind.NOT_GUARDING_END
    return [(event.kind, event.detail) for event in events if event.kind in kinds]


def test_limits_are_there_before_a_patch_starts(files):
    rig, wanted = Rig(files), Bench(files.parent).guarding
    started = {}
    for _ in range(300):
        _, _, frames = rig.run(1)
        for frame in frames:
            if frame.can_id == 0 and frame.data[0] == 1:
                started[frame.data[1]] = rig.device(frame.data[1]).get(LIMITS, 0)
    assert started[1] == wanted.limits(0).encode()
    assert started[2] == wanted.limits(1).encode()
    assert not started[3]
    for node_id, is_on in ((1, True), (2, True), (3, False)):
        cob_id, timer = (rig.device(node_id).get(LIVENESS, sub) for sub in (1, 5))
        assert (cob_id >> 31 == 0, timer) == (is_on, 30 * is_on)
    assert news(rig.events) == [(EventKind.NOT_GUARDING, "patches 1, 2")]
    _, events, _ = rig.run(2000)
    assert news(events) == [(EventKind.NOT_GUARDING_END, "")]
    raised, cleared = (frame.data for frame in rig.frames if frame.can_id == 0xFF)
    assert (raised[:2], raised[3:5]) == (EmcyCode.NOT_GUARDING.to_bytes(2, "little"), bytes([1, 2]))
    assert cleared[:2] == bytes(2)


def test_limits_follow_zeros(files):
    rig = Rig(files)
    rig.run(3000)
    first = rig.device(1).get(LIMITS, 0)
    # of the sum, 160 counts on all tactels are 3 N of 120
    rig.patches.added_counts = {1: 160}
    rig.run(500)
    assert rig.device(1).get(LIMITS, 0) == first  # so far they press
    rig.master.cycle.baseline.zero(0)
    rig.run(1500)
    assert len(news(rig.events)) == 2
    was, now = (GuardLimits.decode(data, 16) for data in (first, rig.device(1).get(LIMITS, 0)))
    moved = now.limits - was.limits
    np.testing.assert_allclose(moved, 160, atol=1)
    # the sum moves by the load of what the tactels have drifted
    np.testing.assert_allclose(now.sum_limit - was.sum_limit, now.weights @ moved, rtol=0.01)


def test_a_touched_patch_is_not_written_and_says_that_it_does_not_guard(tmp_path):
    bench = Bench(tmp_path)
    bench.run()
    zero, touched = bench.baseline.felt.zero, bench.baseline.felt.touched
    zero[7] = 0.9 * FOLLOWED * 70e3
    assert (bench.shown(4), bench.due) == ([], None)
    zero[7], touched[3] = 1.1 * FOLLOWED * 70e3, 1
    assert (bench.shown(5), bench.due) == ([], None)
    zero[7] = 1.1 * DIFFERENT * 70e3
    assert bench.shown(6) == [(EventKind.NOT_GUARDING, "patches 1")]
    touched[3] = 0
    assert bench.shown(7) == []
    assert (bench.due, bench.due) == (0, None)
    bench.write(0)
    assert bench.shown(8) == [(EventKind.NOT_GUARDING_END, "")]


def test_a_guarded_tactel_that_is_not_plausible_does_not_guard(tmp_path):
    bench = Bench(tmp_path)
    bench.run()
    bench.plausibility.faults[[16 + DEAD, 40]] = 1  # neither is guarded
    assert bench.shown(4) == []
    bench.plausibility.faults[20] = 1
    assert bench.shown(5) == [(EventKind.NOT_GUARDING, "patches 2")]


def test_a_patch_that_does_not_run_does_not_guard(tmp_path):
    bench = Bench(tmp_path)
    bench.run()
    bench.table.state[0] = PatchState.BOOTING
    assert (bench.shown(4), bench.due) == ([(EventKind.NOT_GUARDING, "patches 1")], None)


def test_a_patch_that_does_not_hold_its_limits_is_not_started(files):
    rig = Rig(files)
    passed_on = rig.patches.shifted

    def forgotten(frame):
        """A bit of what patch 1 reads in segments is not as it was written."""
        if frame.can_id != 0x581 or frame.data[0] >> 5:
            return passed_on(frame)
        return frame._replace(data=frame.data[:3] + bytes([frame.data[3] ^ 1]) + frame.data[4:])

    rig.patches.shifted = forgotten
    _, events, _ = rig.run(3000)
    assert [event.detail for event in events if event.kind is EventKind.PATCH_REFUSED] == [
        "guard limits: others are read than were written"
    ]
    assert (rig.state(1), rig.state(2)) == (PatchState.WRONG, PatchState.OPERATIONAL)
    assert news(events)[-1] == (EventKind.NOT_GUARDING, "patches 1")
    rig.patches.shifted = passed_on
    _, events, _ = rig.run(3000)
    assert rig.state(1) == PatchState.OPERATIONAL
    assert news(events) == [(EventKind.NOT_GUARDING_END, "")]


def test_limits_that_another_client_writes_are_replaced(files):
    rig = Rig(files)
    rig.run(3000)
    wanted = rig.device(1).get(LIMITS, 0)
    rig.say(Frame(0x601, bytes.fromhex("2f 81 20 00 00 00 00 00")))
    rig.run(10)
    assert news(rig.run(100)[1]) == [(EventKind.NOT_GUARDING, "patches 1")]
    rig.run(3000)
    assert rig.device(1).get(LIMITS, 0) == wanted
    assert news(rig.events)[-1] == (EventKind.NOT_GUARDING_END, "")
