"""response_jitter: lateness of a node's answers."""

import numpy as np

from skinbus.sim.effects.response_jitter import ResponseJitter

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


def test_bytes_are_the_same_only_later(simulate, forearm):
    plain = sorted((f.can_id, f.data) for f in simulate(n_syncs=10, arm=forearm).tpdos())
    late = simulate([ResponseJitter()], n_syncs=10, arm=forearm)
    assert sorted((f.can_id, f.data) for f in late.tpdos()) == plain
