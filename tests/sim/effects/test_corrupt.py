"""corrupt: frames cut short or with one bit turned."""

import numpy as np

from skinbus.sim.effects.corrupt import Corrupt


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


def test_one_kind_alone(simulate, pad):
    plain = simulate(n_syncs=20)
    assert (
        spoilt(plain, simulate([Corrupt(probability=1.0, length_share=1.0)], n_syncs=20, restart=False))[1]
        == []
    )
    only_bits = simulate([Corrupt(probability=1.0, length_share=0.0)], n_syncs=20, restart=False)
    assert spoilt(plain, only_bits) == (0, [1] * len(plain.tpdos()))
