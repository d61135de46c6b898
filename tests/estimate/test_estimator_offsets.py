"""What the readings of a board have in common below the threshold is no contact."""

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


@pytest.mark.parametrize("level", ["kmeans", "fit", "full"])
@pytest.mark.parametrize("boards", ["one", "all"])
@pytest.mark.parametrize("with_baseline", [False, True])
def test_offset_below_the_threshold_is_no_contact(level, boards, with_baseline):
    assert cycles_with_contacts(level, 400.0, boards, with_baseline, 300, 51) == 0


def held_finger(level, drift, seconds, with_baseline, seed):
    """Forces in sum (n,) and numbers of contacts (n,) under a finger of 8 N while all zeros drift, Pa/s."""
    arm = load_arm("forearm", check_load=False)
    estimator, rng = Estimator(arm, level), np.random.default_rng(seed)
    baseline = Baseline(arm) if with_baseline else None
    s, a = float(arm.patch_s[BOARD]) + 0.003, float(arm.patch_a[BOARD]) - 0.002
    d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, s, a)
    pressed = arm.patches[BOARD].patch.law.pressure(d, 8.0)
    period_s, forces, counts = 0.1, [], []
    for k in range(-20, round(seconds / period_s)):
        pressures = SIGMA * rng.standard_normal(arm.n_tactels)
        if k >= 0:
            pressures += pressed + drift * k * period_s
        t_ns = round(1e9 * (k + 20) * period_s)
        if baseline is not None:
            baseline.apply(pressures, t_ns)
        contacts = estimator.update(pressures, t_ns, baseline=baseline)
        if k >= 0:
            forces.append(contacts.force.sum())
            counts.append(len(contacts))
    return np.array(forces), np.array(counts)


@pytest.mark.parametrize("level", ["fit", "full"])
@pytest.mark.parametrize("with_baseline", [False, True])
def test_held_finger_keeps_its_force_through_a_drift(level, with_baseline):
    forces, counts = held_finger(level, 5.0, 20.0, with_baseline, 55)
    print(forces[:20].mean(), forces[-20:].mean(), np.unique(counts))
    assert (counts == 1).all()
    assert forces[-20:].mean() == pytest.approx(forces[:20].mean(), rel=0.05)


@pytest.mark.parametrize("level", ["fit", "full"])
def test_long_drift_makes_hardly_a_contact_around_a_held_finger(level):
    """600 Pa by then, of which the baseline follows what the board's free tactels show."""
    forces, counts = held_finger(level, 5.0, 120.0, True, 56)
    print(forces[:20].mean(), forces[-20:].mean(), np.unique(counts, return_counts=True))
    assert (counts == 1).mean() >= 0.99
    assert forces[-20:].mean() == pytest.approx(forces[:20].mean(), rel=0.1)


def test_press_on_a_board_with_an_offset_is_one_contact_with_its_force():
    arm = load_arm("forearm", check_load=False)
    estimator, rng = Estimator(arm, "fit"), np.random.default_rng(52)
    s, a = float(arm.patch_s[BOARD]) + 0.003, float(arm.patch_a[BOARD]) - 0.002
    d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, s, a)
    for force in (1.0, 3.0, 10.0):
        offset = np.where(arm.tactel_patch == BOARD, 200.0, 0.0)  # boards beside it would keep theirs
        pressed = arm.patches[BOARD].patch.law.pressure(d, force) + offset
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
