"""Every effect by itself: what effects make of the traffic and of time."""

from itertools import pairwise

import numpy as np

from skinbus.objects.cia import HEARTBEAT_PRODUCER
from skinbus.sim import load_scene
from skinbus.sim.effect import stream
from skinbus.sim.effects.mounting import SyncJitter
from skinbus.sim.effects.traffic import (
    BabblingNode,
    BusOff,
    ClockDrift,
    Corrupt,
    Delay,
    Loss,
    PatchReset,
    PatchSilent,
    ResponseJitter,
)
from skinbus.sim.scene import Scene
from skinbus.sim.world import World

# --- sync_jitter: the instants of sampling scatter as they should.


def test_sampling_instants_scatter_normally_about_the_right_ones(forearm):
    step = SyncJitter(sigma_us=100.0).bind(forearm, stream(7, "sync_jitter"))
    errors = np.array([step(0.02 * k) - 0.02 * k for k in range(4000)])
    assert abs(errors.mean()) < 4 * 100e-6 / np.sqrt(4000)
    assert abs(errors.std() / 100e-6 - 1.0) < 0.05


# --- clock_drift: rates that scatter, and heartbeats that show them.


def test_heartbeats_of_a_fast_clock_come_early():
    base = load_scene("pad")
    scene = Scene(
        "test", base.arm, duration_s=1.0, layer=base.layer, effects=[ClockDrift(sigma_ppm=50_000.0)]
    )
    world = World(scene)
    ppm = float(world.sampler.clock_ppm[0])
    assert abs(ppm) > 1000
    beats = []
    wake_ns = world.step(0).wake_ns
    while len(beats) < 6:
        now_ns = wake_ns
        step = world.step(now_ns)
        beats += [now_ns for f in step.frames if f.can_id == 0x701]
        wake_ns = step.wake_ns
        if step.frames:
            world.devices[0].set(HEARTBEAT_PRODUCER, 0, 100)
    period = np.diff(beats[2:]).mean()
    assert abs(period / (100e6 / (1.0 + 1e-6 * ppm)) - 1.0) < 1e-5


# --- patch_reset: boards boot again, when told and at random.


def test_named_board_boots_again_at_its_time(simulate, forearm):
    run = simulate([PatchReset(resets=((3, 0.2), (5, 0.3)), per_hour=0.0)], n_syncs=30, arm=forearm)
    boots = run.boots()
    assert [f.can_id - 0x700 for f in boots[24:]] == [3, 5]
    assert len(run.tpdos(3)) == 4 * 29, "the SYNC at which it resets is not answered"
    assert len(run.tpdos(4)) == 4 * 30


# --- patch_silent: boards go, and come back booting.


def test_silent_board_says_nothing_between_its_times_and_then_boots(simulate, forearm):
    run = simulate([PatchSilent(nodes=(2, 9), from_s=0.2, to_s=0.4)], n_syncs=30, arm=forearm)
    for node_id in (2, 9):
        assert len(run.tpdos(node_id)) == 4 * (10 + 9), "down for 10 cycles, one more to be started again"
    assert len(run.tpdos(3)) == 4 * 30
    assert [f.can_id - 0x700 for f in run.boots()[24:]] == [2, 9]


# --- bus_off: boards off the bus, running on, and an EMCY when they are back.


def test_board_off_the_bus_misses_its_cycles_and_reports_its_return(simulate, forearm):
    run = simulate([BusOff(nodes=(4,), at_s=0.1, recovery_s=0.19)], n_syncs=30, arm=forearm)
    assert len(run.tpdos(4)) == 4 * (30 - 10)
    assert len(run.boots()) == 24, "it does not boot: it never stopped"
    emcy = [f for f in run.frames if f.can_id == 0x084]
    assert [f.data[:2] for f in emcy] == [b"\x40\x81"]
    assert len(emcy[0].data) == 8


# --- response_jitter: lateness of a node's answers.


PERIOD_NS = 20_000_000


def lateness(run):
    """Return (n_cycles, n_patches) ns of the TPDOs behind their SYNC, of nodes that said all four at once."""
    late = {}
    for f in run.tpdos():
        late.setdefault((f.t_ns // PERIOD_NS, f.can_id & 0x7F), []).append(f.t_ns % PERIOD_NS)
    assert all(len(times) == 4 for times in late.values())
    assert all(len(set(times)) == 1 for times in late.values()), "all frames of a node are late together"
    return np.array([times[0] for times in late.values()])


def test_lateness_is_half_normal(simulate, forearm):
    late = lateness(simulate([ResponseJitter(sigma_us=300.0)], n_syncs=60, arm=forearm)) / 300e3
    n = len(late)
    assert n == 60 * 24
    assert (late >= 0).all()
    assert abs(np.mean(late**2) - 1.0) < 4 * np.sqrt(2 / n)
    assert abs(late.mean() - np.sqrt(2 / np.pi)) < 4 * 0.6 / np.sqrt(n)


# --- babbling_node: its rate, its identifier, its times.


def babble(run):
    return [f for f in run.frames if f.can_id == 0x010]


def test_frames_come_at_their_rate_between_their_times(simulate, pad):
    run = simulate([BabblingNode(rate_hz=2000.0, from_s=0.1, to_s=0.3)], n_syncs=50)
    frames = babble(run)
    assert abs(len(frames) - 400) <= 1
    gaps = {b.t_ns - a.t_ns for a, b in pairwise(frames)}
    assert gaps == {500_000}


# --- corrupt: frames cut short or with one bit turned.


def spoilt(plain, run):
    """Return (number cut short, numbers of bits turned in the others that differ)."""
    short, bits = 0, []
    for before, after in zip(plain.tpdos(), run.tpdos(), strict=True):
        assert before.can_id == after.can_id
        if len(after.data) < len(before.data):
            assert before.data.startswith(after.data)
            short += 1
        elif after.data != before.data:
            bits.append(sum((x ^ y).bit_count() for x, y in zip(before.data, after.data, strict=True)))
    return short, bits


def test_shares_are_the_parameters_and_damage_is_one_bit_or_a_cut(simulate, forearm):
    plain = simulate(n_syncs=50, arm=forearm)
    run = simulate([Corrupt(probability=0.1, length_share=0.25)], n_syncs=50, arm=forearm)
    short, bits = spoilt(plain, run)
    n = len(plain.tpdos())
    assert abs((short + len(bits)) / n - 0.1) < 4 * np.sqrt(0.09 / n)
    assert abs(short / (short + len(bits)) - 0.25) < 4 * np.sqrt(0.19 / (0.1 * n))
    assert set(bits) == {1}


# --- delay: constant and random lateness, in order.


def test_lateness_has_its_constant_and_its_mean(simulate, forearm):
    run = simulate([Delay(constant_us=200.0, mean_us=100.0)], n_syncs=40, arm=forearm)
    late = np.array([f.t_ns % PERIOD_NS for f in run.tpdos()]) / 1e3
    n = len(late)
    assert n == 40 * 24 * 4
    assert late.min() >= 200.0
    assert abs(late.mean() - 300.0) < 4 * 100 / np.sqrt(n)
    assert abs(late.std() / 100.0 - 1.0) < 0.1


def test_frames_of_one_identifier_stay_in_order(simulate, pad):
    """With delays of many periods, the readings still come in the order in which they were taken."""
    plain = [f.data for f in simulate(n_syncs=60).frames if f.can_id == 0x181]
    late = [
        f.data
        for f in simulate([Delay(constant_us=0.0, mean_us=50_000.0)], n_syncs=60).frames
        if f.can_id == 0x181
    ]
    assert len(late) > 30
    assert late == plain[: len(late)]


# --- loss: the right share, frame by frame, independent of other traffic.


def test_share_of_lost_frames_is_the_probability(simulate, forearm):
    run = simulate([Loss(probability=0.1)], n_syncs=50, arm=forearm)
    n = 50 * 24 * 4
    assert abs(len(run.tpdos()) / n - 0.9) < 4 * np.sqrt(0.1 * 0.9 / n)
