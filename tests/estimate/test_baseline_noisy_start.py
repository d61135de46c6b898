"""The noise of tactels: measured before the first contact, and never raised by a press; no touch is lost."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.estimate import Baseline, Estimator
from tests.marks import slow

SEED = 20261130
OFFSET = 300.0
"""Pa, of the zeros at the start."""


class Start:
    """A pad from its first reading on; the noise is that declared times a factor."""

    def __init__(self, seed, factor, rate_hz):
        self.arm = load_arm("pad")
        self.rng = np.random.default_rng(seed)
        self.baseline, self.estimator = Baseline(self.arm), Estimator(self.arm, "fit")
        self.noise = np.asarray(self.arm.tactel_noise) * factor
        self.zero = OFFSET * self.rng.standard_normal(self.arm.n_tactels)
        self.period_ns, self.t_ns = round(1e9 / rate_hz), 0

    def cycle(self, force=0.0):
        """Contacts of one cycle under a press in the middle."""
        self.t_ns += self.period_ns
        placed = self.arm.patches[0]
        read = self.zero + self.noise * self.rng.standard_normal(self.arm.n_tactels)
        if force:
            read += placed.patch.law.pressure(self.arm.distance(slice(None), placed.s, placed.a), force)
        self.baseline.apply(read, self.t_ns)
        return self.estimator.update(read, self.t_ns, baseline=self.baseline)


@pytest.mark.parametrize("rate_hz", [20, *slow(100)])
@pytest.mark.parametrize("factor", [1.5, 2.0, 3.0, 5.0, 10.0])
def test_a_noisy_board_makes_no_contact_from_its_first_reading_on(factor, rate_hz):
    for k in range(3):
        start = Start([SEED, k], factor, rate_hz)
        false = [n for n in range(5 * rate_hz) if len(start.cycle())]
        assert not false
        assert not start.baseline.suspect.any()
        np.testing.assert_allclose(start.baseline.noise, start.noise, rtol=0.6)


@pytest.mark.parametrize("factor", [2.0, 5.0])
def test_a_noisy_tactel_among_others_makes_no_contact_once_it_has_been_read_a_few_times(factor):
    for k in range(5):
        start = Start([SEED, 10 + k], 1.0, 50)
        start.noise[start.rng.integers(16)] *= factor
        assert not [n for n in range(250) if len(start.cycle()) and n > 5]


@pytest.mark.parametrize(
    ("onset", "factor", "seen"), [(0, 1.0, 2), (0, 2.0, 2), (3, 1.0, 11), (10, 1.0, 18), (20, 1.0, 28)]
)
def test_a_press_at_power_on_or_before_there_are_zeros_is_a_contact_soon_and_stays_one(onset, factor, seen):
    for k in range(3):
        start = Start([SEED, 20 + k], factor, 50)
        rise = np.clip((np.arange(150) - onset) / 5, 0.0, 1.0) if onset else np.ones(150)
        found = [len(start.cycle(8.0 * share)) for share in rise]
        assert found[seen:] == [1] * (150 - seen)


@pytest.mark.parametrize("start_s", [1.0, 3.0, 30.0])
@pytest.mark.parametrize("pa_per_s", [*slow(200.0, 1000.0), 5000.0])
def test_a_press_that_grows_slowly_is_a_contact_and_stays_one(start_s, pa_per_s):
    """Its readings do not raise the noise, and so the threshold, ahead of it."""
    for k in range(2):
        start = Start([SEED, 40 + k], 1.0, 50)
        law = start.arm.patches[0].patch.law
        strongest = law.pressure(np.zeros(1), 1.0)[0]  # Pa for 1 N
        growing, held = [], []
        for n in range(round(50 * (start_s + 6000.0 / pa_per_s + 3.0))):
            rise = max(n / 50 - start_s, 0.0) * pa_per_s
            contacts = start.cycle(min(rise, 6000.0) / strongest)
            if rise >= 6000.0:
                held.append(len(contacts))
            elif (
                rise >= 3500.0
            ):  # between four tactels each feels a third of it, and the threshold is 1200 Pa
                growing.append(len(contacts))
        assert sum(growing) >= 0.9 * len(growing)
        assert held == [1] * len(held)
        assert len(held) >= 140
