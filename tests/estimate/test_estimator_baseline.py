"""The estimator told by a baseline: what is touched, how noisy it is, and where full scale has moved to."""

import numpy as np
import pytest

from skinbus.estimate import Baseline, Estimator, Quality
from skinbus.model import Arm, Cone, Transducer, grid
from tests.marks import levels
from tests.skins import PAD, cone_forearm

SIGMA = 200.0
FULL_SCALE = 60e3
PERIOD_NS = 20_000_000


class Skin:
    """A pad, its baseline and its estimator; seed 5."""

    def __init__(self, level="kmeans"):
        self.arm = Arm.single_patch(
            grid(4, 4, 0.010), law=Cone(4e6), transducer=Transducer(full_scale=FULL_SCALE)
        )
        self.baseline, self.estimator = Baseline(self.arm), Estimator(self.arm, level)
        self.rng = np.random.default_rng(5)
        self.t_ns = 0

    def read(self, pressures=0.0, *, sigma=SIGMA):
        """One cycle of pressures with noise; return its contacts."""
        self.t_ns += PERIOD_NS
        out = pressures + sigma * self.rng.standard_normal(self.arm.n_tactels)
        self.baseline.apply(out, self.t_ns)
        return self.estimator.update(out, self.t_ns, baseline=self.baseline)

    def press(self, force):
        return Cone(4e6).pressure(self.arm.distance(slice(None), 0.005, 0.005), force)


def test_contact_near_the_threshold_does_not_flicker():
    skin = Skin()
    for _ in range(50):
        skin.read()
    tactel = int(np.argmax(skin.press(5.0)))
    near = np.zeros(skin.arm.n_tactels)
    near[tactel] = 1.1 * skin.baseline.threshold[tactel]
    for _ in range(20):  # until noise has lifted it over the threshold
        skin.read(1.2 * near)
    # noise of a fifth: at 1.1 thresholds it falls below one now and then, never below the release
    n = [len(skin.read(near, sigma=0.5 * SIGMA)) for _ in range(300)]
    assert n == [1] * 300
    below = [near[tactel] + 0.5 * SIGMA * x for x in np.random.default_rng(5).standard_normal(300)]
    assert min(below) < skin.baseline.threshold[tactel]


@levels
def test_held_touch_beside_a_higher_reading_that_is_none_is_one_contact(level):
    skin = Skin(level)
    for _ in range(50):
        skin.read()
    at, beside = 5, 6
    share = np.zeros(skin.arm.n_tactels)
    for share[at], share[beside], n in ((1.3, 0.0, 20), (0.9, 0.95, 1)):
        for _ in range(n):
            contacts = skin.read(share * skin.baseline.threshold, sigma=0.0)
    assert len(contacts) == 1


@pytest.mark.slow
def test_skin_that_has_become_noisier_makes_no_contact():
    skin = Skin()  # other levels begin with the contacts of this one
    for n in range(3000):
        skin.read(sigma=SIGMA * (1.0 + min(n / 1500, 1.0)))
    assert np.median(skin.baseline.noise) > 1.8 * SIGMA
    assert sum(len(skin.read(sigma=2 * SIGMA)) for _ in range(3000)) == 0


def test_full_scale_is_still_full_scale_with_a_zero_taken_off():
    skin = Skin("fit")
    for _ in range(50):
        skin.read(800.0)  # its zero
    strong = np.minimum(skin.press(60.0) + 800.0, FULL_SCALE)
    assert (strong == FULL_SCALE).any()
    contacts = skin.read(strong, sigma=0.0)
    assert (contacts.quality & Quality.SATURATED).any()
    # a reading at full scale says "at least": the force is not that of the clipped peak
    assert contacts.force[0] == pytest.approx(60.0, rel=0.1)


def test_baseline_of_another_arm_is_refused():
    with pytest.raises(ValueError, match="other tactels"):
        Estimator(PAD).update(np.zeros(16), 0, baseline=Baseline(cone_forearm()))


def test_read_only_and_foreign_arrays_compile_nothing_anew():
    from numba.core import event

    estimator = Estimator(PAD, "kmeans")
    values = np.zeros(16)
    values.setflags(write=False)
    with event.install_recorder("numba:compile") as seen:
        estimator.update(values, 0, valid=np.broadcast_to(True, 1))
        estimator.update(values.astype(np.float32), 0)
        estimator.update([0] * 16, 0, valid=[True])
    assert not seen.buffer
