"""What the readings of a board have in common below the threshold is no contact.

`python -m tests.estimate.test_estimator_offsets 100000` counts cycles with a contact.
"""

import sys

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.estimate import Baseline, Estimator

SIGMA, PERIOD_NS = 200.0, 20_000_000
BOARD = 5


def cycles_with_contacts(level, offset, boards, with_baseline, n, seed):
    """Cycles of n in which there are contacts on a forearm that nothing touches, after an offset (Pa)."""
    arm = load_arm("forearm", check_load=False)
    shift = np.where((arm.tactel_patch == BOARD) | (boards == "all"), offset, 0.0)
    estimator, rng = Estimator(arm, level), np.random.default_rng(seed)
    baseline = Baseline(arm) if with_baseline else None
    found = 0
    for k in range(-60, n):
        pressures = SIGMA * rng.standard_normal(arm.n_tactels) + (shift if k >= 0 else 0.0)
        if baseline is not None:
            baseline.apply(pressures, (k + 60) * PERIOD_NS)
        found += len(estimator.update(pressures, k * PERIOD_NS, baseline=baseline)) > 0
    return found


@pytest.mark.parametrize("level", ["fit", "full"])
@pytest.mark.parametrize("boards", ["one", "all"])
@pytest.mark.parametrize("with_baseline", [False, True])
def test_offset_below_the_threshold_is_no_contact(level, boards, with_baseline):
    assert cycles_with_contacts(level, 400.0, boards, with_baseline, 300, 51) == 0


def test_press_on_a_board_with_an_offset_is_one_contact_with_its_force():
    arm = load_arm("forearm", check_load=False)
    estimator, rng = Estimator(arm, "fit"), np.random.default_rng(52)
    s, a = float(arm.patch_s[BOARD]) + 0.003, float(arm.patch_a[BOARD]) - 0.002
    d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, s, a)
    for force in (1.0, 3.0, 10.0):
        pressed = arm.patches[BOARD].patch.law.pressure(d, force) + 200.0
        for k in range(50):
            contacts = estimator.update(pressed + SIGMA * rng.standard_normal(arm.n_tactels), k)
            assert len(contacts) == 1
            # 200 Pa on what a contact covers, some 4 cm2, are 0.08 N; the noise makes up to 0.2 N
            assert contacts.force[0] == pytest.approx(force, abs=1.0, rel=0.1)


@pytest.mark.parametrize("level", ["kmeans", "fit"])
def test_press_that_all_of_a_board_feels_is_no_offset(level):
    arm = load_arm("forearm", check_load=False)
    estimator, rng = Estimator(arm, level), np.random.default_rng(53)
    wide = np.where(arm.tactel_patch == BOARD, 1.5 * arm.tactel_threshold, 0.0)
    for k in range(50):
        assert len(estimator.update(wide + SIGMA * rng.standard_normal(arm.n_tactels), k)) > 0


if __name__ == "__main__":
    for level in ("fit", "full"):
        for boards in ("one", "all"):
            for with_baseline in (False, True):
                for offset in (300.0, 400.0):
                    n = int(sys.argv[1])
                    found = cycles_with_contacts(level, offset, boards, with_baseline, n, 54)
                    print(level, boards, with_baseline, offset, found, "of", n, flush=True)
