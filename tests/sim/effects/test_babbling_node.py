"""babbling_node: its rate, its identifier, its times."""

from itertools import pairwise

from skinbus.sim.effects.babbling_node import BabblingNode


def babble(run):
    return [f for f in run.frames if f.can_id == 0x010]


def test_frames_come_at_their_rate_between_their_times(simulate, pad):
    run = simulate([BabblingNode(rate_hz=2000.0, from_s=0.1, to_s=0.3)], n_syncs=50)
    frames = babble(run)
    assert abs(len(frames) - 400) <= 1
    gaps = {b.t_ns - a.t_ns for a, b in pairwise(frames)}
    assert gaps == {500_000}


def test_bytes_are_random_and_readings_are_not_touched(simulate, pad):
    run = simulate([BabblingNode()], n_syncs=20)
    data = b"".join(f.data for f in babble(run))
    assert abs(sum(byte.bit_count() for byte in data) / (8 * len(data)) - 0.5) < 0.03
    assert [f[:2] for f in run.tpdos()] == [f[:2] for f in simulate(n_syncs=20).tpdos()]
