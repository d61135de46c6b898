"""What a cycle publishes is true within what it claims: on uncalibrated boards, and after a press."""

import numpy as np
import pytest

from skinbus.config.system import load_arm, ods_of
from skinbus.estimate import Estimator, Quality
from skinbus.master.cycle import Cycle
from skinbus.objects.readings import ReadingsPlan
from skinbus.sim.effects.readings import Viscoelastic
from skinbus.sim.laws import Elastic
from tests.skins import feel_of

pytestmark = pytest.mark.slow

SEED = 20261123
PERIOD_NS = 10_000_000
NOISE = 200.0


@pytest.mark.parametrize("gain", [0.8, 1.2])
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
    assert np.abs(off).max() < 3.0


@pytest.mark.parametrize("level", ["kmeans", "fit"])
@pytest.mark.parametrize(("relaxation", "tau_s"), [(0.1, 4.0), (0.05, 1.0)])
def test_what_a_cover_still_shows_of_a_press_that_has_gone_is_recovering_and_no_surer_than_that(
    relaxation, tau_s, level
):
    held_s, after = 5.0, 0
    for t_s, pressed, contacts in _creeping(
        level, relaxation, tau_s, [(1.5, 0.0), (held_s, 15.0), (4.0, 0.0)]
    ):
        for c in range(len(contacts)):
            is_recovering = bool(contacts.quality[c] & Quality.RECOVERING)
            assert is_recovering == (pressed == 0.0), t_s
            after += is_recovering
            assert contacts.quality[c] & Quality.IMPAIRED, "a tactel beside it is not healthy"
            sd = np.sqrt(contacts.covariance[c, 2, 2])
            assert sd == 0.0 or pressed or contacts.force[c] < 3.0 * sd, t_s
    assert after > 10


def test_contacts_that_a_missing_board_might_have_felt_are_impaired_and_others_are_not():
    arm, missing = load_arm("forearm"), 4
    cycle = Cycle(arm, ReadingsPlan(arm, ods_of(arm)), Estimator(arm, "fit"))
    beside = arm.patch_a[missing] - 27e-3
    felt = feel_of(arm, Elastic(), 6e-3)(np.array([[arm.patch_s[missing], beside, 8.0], [0.076, 0.0, 8.0]]))
    fresh = np.arange(arm.n_patches) != missing
    contacts, _ = cycle.run(0, arm.patches[0].patch.transducer.counts(felt), fresh)
    assert {c: bool(q & Quality.IMPAIRED) for c, q in zip(contacts.patch, contacts.quality, strict=True)} == {
        missing - 1: True,
        8: False,
    }


def _creeping(level, relaxation, tau_s, course):
    """Yield time, force and contacts of a pad with a cover that creeps, pressed as (seconds, N) say."""
    rng, arm = np.random.default_rng(SEED), load_arm("pad")
    arm.tactel_healthy = np.arange(arm.n_tactels) != 3
    cycle = Cycle(arm, ReadingsPlan(arm, ods_of(arm)), Estimator(arm, level))
    middle, fresh = arm.patches[0], np.ones(1, np.bool_)
    felt = feel_of(arm, Elastic(), 6e-3)(np.array([[middle.s + 4e-3, middle.a - 3e-3, 1.0]]))
    creep = Viscoelastic(relaxation=relaxation, tau_s=tau_s).bind(arm, rng)
    ends = np.cumsum([seconds for seconds, _ in course])
    for k in range(int(ends[-1] / 0.02)):
        force = course[np.searchsorted(ends, 0.02 * k, side="right")][1]
        pressures = creep(felt * force, 0.02 * k)
        read = middle.patch.transducer.counts(pressures + NOISE * rng.standard_normal(arm.n_tactels))
        yield 0.02 * k, force, cycle.run(20_000_000 * k, read, fresh)[0]
