"""The noise of tactels: measured before the first contact, and never raised by a press; no touch is lost."""

import functools
from itertools import product

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.estimate import Baseline, Estimator
from skinbus.model import Arm, Link, PlacedPatch, Surface

SEED = 20261130
OFFSET = 300.0
"""Pa, of the zeros at the start."""
PATCH = load_arm("pad").patches[0].patch


class Start:
    """Boards far apart from their first reading on; the noise of each is that declared times its factor."""

    def __init__(self, seed, factors, rate_hz):
        places = 0.1 + 0.2 * np.arange(len(factors))
        placed = [PlacedPatch(patch=PATCH, node_id=n, link=0, s=s, a=0.0) for n, s in enumerate(places, 1)]
        self.arm = Arm("boards", [Link("plane", Surface.plane(0.2 * len(factors), 0.2))], placed)
        self.rng = np.random.default_rng(seed)
        self.baseline, self.estimator = Baseline(self.arm), Estimator(self.arm, "fit")
        self.noise = self.arm.tactel_noise * np.repeat(factors, 16)
        self.zero = OFFSET * self.rng.standard_normal(self.arm.n_tactels)
        self.press = PATCH.law.pressure(np.hypot(*PATCH.tactels_uv.T), 1.0)  # Pa for 1 N
        self.period_ns, self.t_ns = round(1e9 / rate_hz), 0

    def cycle(self, force=0.0):
        """Contacts on each board in one cycle under presses in the middle."""
        self.t_ns += self.period_ns
        read = self.zero + self.noise * self.rng.standard_normal(self.arm.n_tactels)
        read += np.outer(np.broadcast_to(force, self.arm.n_patches), self.press).ravel()
        self.baseline.apply(read, self.t_ns)
        contacts = self.estimator.update(read, self.t_ns, baseline=self.baseline)
        return np.bincount(contacts.patch, minlength=self.arm.n_patches)


@pytest.mark.parametrize("rate_hz", [20, 100])
def test_a_noisy_board_makes_no_contact_from_its_first_reading_on(rate_hz):
    start = Start(SEED, [1.5, 2.0, 3.0, 5.0, 10.0] * 3, rate_hz)
    assert not np.any([start.cycle() for _ in range(5 * rate_hz)])
    assert not start.baseline.suspect.any()
    np.testing.assert_allclose(start.baseline.noise, start.noise, rtol=0.6)


def test_a_noisy_tactel_among_others_makes_no_contact_once_it_has_been_read_a_few_times():
    start = Start([SEED, 10], np.ones(10), 50)
    start.noise[16 * np.arange(10) + start.rng.integers(16, size=10)] *= [2.0, 5.0] * 5
    assert not np.any([start.cycle() for _ in range(250)][6:])


@pytest.mark.parametrize(
    ("onset", "factor", "seen"), [(0, 1.0, 2), (0, 2.0, 2), (3, 1.0, 11), (10, 1.0, 18), (20, 1.0, 28)]
)
def test_a_press_at_power_on_or_before_there_are_zeros_is_a_contact_soon_and_stays_one(onset, factor, seen):
    start = Start([SEED, 20], [factor] * 3, 50)
    rise = np.clip((np.arange(150) - onset) / 5, 0.0, 1.0) if onset else np.ones(150)
    assert (np.array([start.cycle(8.0 * share) for share in rise])[seen:] == 1).all()


GROWTHS = [*product((200.0, 1000.0, 5000.0), (1.0, 3.0, 30.0))]
"""Pa/s, and when it begins, s."""


@functools.cache
def growing():
    """Return how much two presses of each kind have risen, Pa, and the contacts that they make."""
    pa_per_s, start_s = np.repeat(GROWTHS, 2, axis=0).T
    start = Start([SEED, 40], np.ones(len(start_s)), 50)
    strongest = PATCH.law.pressure(np.zeros(1), 1.0)
    rise = np.maximum(np.arange(50 * 63)[:, None] / 50 - start_s, 0.0) * pa_per_s
    return rise, np.array([start.cycle(np.minimum(now, 6000.0) / strongest) for now in rise])


@pytest.mark.slow
@pytest.mark.parametrize(("pa_per_s", "start_s"), GROWTHS)
def test_a_press_that_grows_slowly_is_a_contact_and_stays_one(pa_per_s, start_s):
    """Its readings do not raise the noise, and so the threshold, ahead of it."""
    k = 2 * GROWTHS.index((pa_per_s, start_s))
    rise, contacts = (x[:, k : k + 2] for x in growing())
    assert (contacts[rise >= 6000.0] == 1).all()
    # between four tactels each feels a third of it, and the threshold is 1200 Pa
    grows = np.ma.masked_array(contacts, (rise < 3500.0) | (rise >= 6000.0))
    assert (grows.mean(axis=0) >= 0.9).all()
