"""What a cycle publishes is true within what it claims on boards that nobody has calibrated."""

import numpy as np
import pytest

from skinbus.config.system import load_arm, ods_of
from skinbus.estimate import Estimator
from skinbus.master.cycle import Cycle
from skinbus.objects.readings import ReadingsPlan
from skinbus.sim.laws import Elastic
from skinbus.study.skin_models import feel_of

SEED = 20261123
PERIOD_NS = 10_000_000
NOISE = 200.0


@pytest.mark.parametrize("gain", [0.8, 0.9, 1.1, 1.2])
def test_force_is_within_three_sd_on_a_board_whose_gain_is_not_that_of_its_eds(gain):
    rng, arm = np.random.default_rng([SEED, round(10 * gain)]), load_arm("pad")
    cycle = Cycle(arm, ReadingsPlan(arm, ods_of(arm)), Estimator(arm, "fit"))
    transducer, feel = arm.patches[0].patch.transducer, feel_of(arm, Elastic(), 6e-3)
    middle, fresh, off = arm.patches[0], np.ones(1, np.bool_), []
    t_ns = 0
    for touch in range(12):
        place = (middle.s + rng.uniform(-0.012, 0.012), middle.a + rng.uniform(-0.012, 0.012))
        felt = gain * feel(np.array([[*place, force := rng.uniform(3.0, 10.0)]]))
        for k in range(60):
            pressed = felt * np.clip((k - 25) / 10, 0.0, 1.0) + NOISE * rng.standard_normal(arm.n_tactels)
            contacts, _ = cycle.run(t_ns, transducer.counts(pressed), fresh)
            t_ns += PERIOD_NS
        assert len(contacts) == 1, touch
        off.append((contacts.force[0] - force) / np.sqrt(contacts.covariance[0, 2, 2]))
    print(gain, np.round(off, 2))
    assert np.abs(off).max() < 3.0
