"""Tracks without a contact: touches that meet, gaps between boards, estimates that jump, what is a lift."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.estimate import Estimator
from skinbus.estimate.tracking import TrackState
from tests.estimate.crossing import SPEEDS, meet
from tests.estimate.track_rig import Film
from tests.skins import cone_forearm

HELD, LIFT, COAST = TrackState.HELD, TrackState.LIFT, TrackState.COAST
SHARP = np.diag([2e-4, 2e-4, 0.1]) ** 2


@pytest.fixture
def film():
    return Film()


# --- Two that meet, contacts by hand ---------------------------------------------------------------


def cross(film, speed, seen_apart, merged):
    """Show two touches that run through each other, closer than ``seen_apart`` as ``merged(n, s1, s2)``."""
    seen = []
    n_half = round(0.05 / (speed * 0.02))
    for n in range(-n_half, n_half + 1):
        s1, s2 = 0.2 + speed * 0.02 * n, 0.2 - speed * 0.02 * n
        if abs(s1 - s2) < seen_apart:
            tracks = film.show(merged(s1, s2))
        else:
            tracks = film.show((1, s1, 0.1, 5.0), (1, s2, 0.1, 5.0))
        seen.append(tracks.identity[tracks.contact_row].tolist())
    return seen[0], seen[-1]


MERGED = {
    "the sum in the middle": lambda s1, s2: (1, 0.2, 0.1, 10.0),
    "the sum, off by 5 mm": lambda s1, s2: (1, 0.205, 0.105, 13.0),
}


@pytest.mark.parametrize("merged", MERGED.values(), ids=MERGED)
@pytest.mark.parametrize(("speed", "apart"), [(0.04, 0.012), (0.1, 0.012), (0.2, 0.024), (0.7, 0.024)])
def test_touches_that_cross_keep_their_identities_while_their_sum_is_seen(film, speed, apart, merged):
    before, after = cross(film, speed, apart, merged)
    assert before == after


def test_lift_beside_another_touch_is_a_lift_in_time(film):
    for _ in range(20):
        film.show((1, 0.10, 0.0, 5.0), (1, 0.113, 0.0, 5.0))
    states = [film.show((1, 0.10, 0.0, 5.0)).state.tolist() for _ in range(3)]
    assert states == [[HELD, COAST], [HELD, COAST], [HELD, LIFT]]


def test_touch_that_began_when_another_was_no_longer_seen_does_not_hide_it(film):
    for _ in range(5):
        film.show((1, 0.10, 0.0, 5.0))
    film.show((1, 0.125, 0.0, 4.0))
    states = [film.show((1, 0.125, 0.0, 11.0)).state.tolist() for _ in range(2)]
    assert states == [[COAST, HELD], [LIFT, HELD]]


def test_touches_that_stay_merged_become_one(film):
    for _ in range(20):
        film.show((1, 0.10, 0.0, 5.0), (1, 0.113, 0.0, 5.0))
    states = [film.show((1, 0.1065, 0.0, 10.0)).state.tolist() for _ in range(60)]
    assert len(states[-1]) == 1
    assert sum(LIFT in s for s in states) == 1


# --- Gaps and jumps --------------------------------------------------------------------------------


def slide(film, unseen):
    """Slide along a board and off it, not seen where ``unseen(s)``; return the tracks of each cycle."""
    places = np.arange(0.08, 0.145, 5e-4)  # 0.1 m/s
    return [film.show(*[] if unseen(s) else [(1, s, 0.005)], after_ns=5_000_000) for s in places]


def test_touch_that_moves_keeps_its_identity_through_a_gap_where_no_tactel_feels_it(film):
    # the outermost tactels of this board are at 0.115
    tracks = slide(film, lambda s: 0.1255 < s < 0.1305)
    assert {i for t in tracks for i in t.identity.tolist()} == {1}
    assert {int(t.state[0]) for t in tracks} >= {TrackState.MOVE, COAST}


def test_touch_that_slides_off_the_skin_has_ended_when_it_is_past_the_gap(film):
    states = [t.state.tolist() for t in slide(film, lambda s: s > 0.126)]
    assert 3 <= states.index([LIFT]) - states.index([COAST]) <= 12


def test_touch_that_lifts_while_it_moves_amid_tactels_is_a_lift_in_time(film):
    states = [t.state.tolist() for t in slide(film, lambda s: s > 0.105)]
    first = states.index([COAST])
    assert states[first : first + 4] == [[COAST], [COAST], [LIFT], []]


@pytest.mark.parametrize("n_wrong", [1, 2, 5])
def test_estimates_that_jump_for_some_cycles_do_not_cost_the_identity(film, n_wrong):
    for n in range(60):
        s, wrong = 0.06 + 1e-3 * n, 30 <= n < 30 + n_wrong
        tracks = film.show((1, s - 6e-3 * wrong, 6e-3 * wrong), after_ns=10_000_000, covariance=[SHARP])
        if n_wrong == 1 and n == 31:
            assert tracks.mean[0, :4] == pytest.approx([s, 0.0, 0.1, 0.0], abs=1.5e-3)
    assert tracks.identity.tolist() == [1]


def test_hand_that_stops_is_followed_in_the_second_cycle(film):
    for n in range(20):
        film.show((1, 0.1 + 0.008 * n, 0.0), covariance=[SHARP])
    for _ in range(2):
        tracks = film.show((1, 0.252, 0.0), covariance=[SHARP])
    assert (tracks.identity.tolist(), tracks.mean[0, 0]) == ([1], pytest.approx(0.252, abs=1e-3))


# --- Real estimates --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("arm", [cone_forearm, lambda: load_arm("forearm")], ids=["cone", "ships"])
def test_at_up_to_1_m_per_s_each_95_of_100_crossings_keep_their_identities(arm):
    # at 0.1 m/s, fit with the cone, it is 191 of 200: a touch is at a seam for longer, and badly placed there
    estimators = [Estimator(arm(), level) for level in ("fit", "full")]
    kept = [np.sum([meet(estimators, speed, seed) for seed in range(25)], axis=0) for speed in SPEEDS]
    assert (kept >= np.c_[[91, 95, 95, 95, 95]]).all()
