"""What the readings of a board have in common below the threshold is no contact."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.estimate import Baseline, Estimator
from tests.marks import fits, levels

SIGMA = 200.0
BOARD = 5


@pytest.fixture(scope="module")
def arm():
    return load_arm("forearm", check_load=False)


def pressed_by(arm, force):
    """What a finger on a board makes, Pa."""
    s, a = float(arm.patch_s[BOARD]) + 0.003, float(arm.patch_a[BOARD]) - 0.002
    d = arm.distance(slice(None), s, a)
    return arm.patches[BOARD].patch.law.pressure(d, force)


def contacts_under(arm, level, shift, n, *, with_baseline, period_s=0.02, quiet=60, seed=51):
    """Yield the contacts of n cycles of noise and ``shift(seconds)`` Pa, after quiet ones."""
    estimator, rng = Estimator(arm, level), np.random.default_rng(seed)
    baseline = Baseline(arm) if with_baseline else None
    for k in range(-quiet, n):
        pressures = SIGMA * rng.standard_normal(arm.n_tactels) + (shift(k * period_s) if k >= 0 else 0.0)
        t_ns = round(1e9 * (k + quiet) * period_s)
        if baseline is not None:
            baseline.apply(pressures, t_ns)
        contacts = estimator.update(pressures, t_ns, baseline=baseline)
        if k >= 0:
            yield contacts


@levels
@pytest.mark.parametrize("boards", ["one", "all"])
@pytest.mark.parametrize("with_baseline", [False, True])
def test_offset_below_the_threshold_is_no_contact(arm, level, boards, with_baseline):
    shift = np.where((arm.tactel_patch == BOARD) | (boards == "all"), 400.0, 0.0)
    found = contacts_under(arm, level, lambda t_s: shift, 300, with_baseline=with_baseline)
    assert not any(len(contacts) for contacts in found)


@fits
@pytest.mark.parametrize(
    ("seconds", "with_baseline", "share", "slack"),
    [(20, False, 1.0, 0.05), (20, True, 1.0, 0.05), (120, True, 0.99, 0.1)],
)
def test_held_finger_keeps_its_force_through_a_drift(arm, level, seconds, with_baseline, share, slack):
    """Up to 600 Pa, of which the baseline follows what the board's free tactels show."""
    pressed = pressed_by(arm, 8.0)
    settings = {"with_baseline": with_baseline, "period_s": 0.2, "quiet": 20, "seed": 55}
    found = list(contacts_under(arm, level, lambda t_s: pressed + 5.0 * t_s, 5 * seconds, **settings))
    forces = [contacts.force.sum() for contacts in found]
    assert np.mean([len(contacts) == 1 for contacts in found]) >= share
    assert np.mean(forces[-20:]) == pytest.approx(np.mean(forces[:20]), rel=slack)


@pytest.mark.parametrize("force", [1.0, 3.0, 10.0])
@pytest.mark.parametrize(("boards", "offset"), [("one", 200.0), ("all", 400.0)])
def test_press_on_boards_with_an_offset_is_one_contact_with_its_force(arm, boards, offset, force):
    offset = np.where((arm.tactel_patch == BOARD) | (boards == "all"), offset, 0.0)
    pressed = pressed_by(arm, force) + offset
    for contacts in contacts_under(arm, "fit", lambda t_s: pressed, 50, with_baseline=False, quiet=0):
        assert len(contacts) == 1
        # 400 Pa on what a contact covers, some 4 cm2, are 0.16 N; the noise makes up to 0.2 N
        assert contacts.force[0] == pytest.approx(force, abs=1.0, rel=0.1)


@pytest.mark.parametrize("level", ["kmeans", "fit"])
def test_press_that_all_of_a_board_feels_is_no_offset(arm, level):
    wide = np.where(arm.tactel_patch == BOARD, 1.5 * arm.tactel_threshold, 0.0)
    found = contacts_under(arm, level, lambda t_s: wide, 10, with_baseline=False, quiet=0)
    assert all(len(contacts) for contacts in found)
