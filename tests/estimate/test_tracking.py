"""Tracks: who is who over time, what they do, and what a cycle without them means."""

import numpy as np
import pytest

from skinbus.estimate.tracking import TrackState
from tests.estimate.track_rig import ARM, PERIOD_NS, SURFACES, Film, contacts

TOUCH, HELD, LIFT, COAST, MOVE = (
    TrackState.TOUCH,
    TrackState.HELD,
    TrackState.LIFT,
    TrackState.COAST,
    TrackState.MOVE,
)


@pytest.fixture
def film():
    return Film()


def test_touch_is_said_in_its_first_cycle_then_held_then_lift_once(film):
    said = [film.show((0, 0.1, 0.0)).state.tolist() for _ in range(3)]
    said += [film.show().state.tolist() for _ in range(4)]
    assert said == [[TOUCH], [HELD], [HELD], [COAST], [COAST], [LIFT], []]


def test_coasting_track_shows_where_it_was_seen_and_when(film):
    seen = film.show((0, 0.1, 0.02, 7.0))
    gone = film.show()
    assert (gone.s[0], gone.a[0], gone.force[0], gone.row[0]) == (0.1, 0.02, 7.0, -1)
    assert gone.seen_ns[0] == seen.t_ns


def test_identity_goes_through_the_wrap(film):
    surface = SURFACES[0]
    half = 0.5 * surface.period
    places = np.linspace(half - 0.05, half + 0.05, 20)
    tracks = [film.show((0, 0.1, float(surface.wrap(a)))) for a in places]
    assert {int(t.identity[0]) for t in tracks} == {1}
    assert tracks[-1].state.tolist() == [MOVE]
    assert tracks[-1].mean[0, 3] == pytest.approx(0.1 / 19 / 0.02, rel=0.05)
    assert abs(tracks[-1].mean[0, 1]) <= half


def test_same_place_on_another_link_is_another_contact(film):
    film.show((0, 0.1, 0.0))
    tracks = film.show((1, 0.1, 0.0))
    assert tracks.identity.tolist() == [1, 2]
    assert tracks.state.tolist() == [COAST, TOUCH]


def test_pairs_are_chosen_together_not_the_nearest_first(film):
    # Two that move together: the nearest pair is a wrong one, the sum over both is right.
    for n in range(10):
        film.show((0, 0.10 + 0.004 * n, 0.0), (0, 0.12 + 0.004 * n, 0.0))
    tracks = film.show((0, 0.156, 0.0), (0, 0.142, 0.0))
    assert tracks.row.tolist() == [1, 0]


def test_impact_does_not_cost_the_identity(film):
    forces = (1.0, 1.0, 80.0, 80.0, 0.5)
    assert {int(film.show((0, 0.1, 0.0, force)).identity[0]) for force in forces} == {1}


def test_sudden_slide_does_not_cost_the_identity(film):
    for _ in range(50):
        film.show((0, 0.1, 0.0))
    tracks = [film.show((0, 0.1 + 0.016 * n, 0.0)) for n in range(1, 10)]  # 0.8 m/s from rest
    assert {int(t.identity[0]) for t in tracks} == {1}


# --- Not seen --------------------------------------------------------------------------------------


def test_patch_without_readings_delays_the_lift_and_says_so(film):
    stale = np.arange(ARM.n_patches) != 0
    film.show((0, 0.1, 0.0))
    tracks = [film.show(fresh=stale) for _ in range(40)]
    assert {int(t.state[0]) for t in tracks} == {COAST}
    assert film.show((0, 0.1, 0.0)).identity.tolist() == [1]


def test_patch_that_stays_away_ends_the_track_after_its_time():
    film = Film(blind_s=0.5)
    film.show((0, 0.1, 0.0))
    states = [film.show(fresh=np.zeros(ARM.n_patches, bool)).state.tolist() for _ in range(27)]
    assert states == [[COAST]] * 25 + [[LIFT]] + [[]]


# --- Identities and slots --------------------------------------------------------------------------


def test_contact_keeps_its_slot_for_life_and_a_freed_slot_rests_for_one_cycle():
    film = Film(n_slots=2)
    film.show((0, 0.1, 0.0), (1, 0.1, 0.0))
    for _ in range(3):
        lifted = film.show((1, 0.1, 0.0), (2, 0.1, 0.0))
    assert (lifted.state.tolist(), lifted.slot.tolist()) == ([LIFT, HELD, HELD], [0, 1, -1])
    after = film.show((1, 0.1, 0.0), (2, 0.1, 0.0))
    assert after.slot[after.contact_row].tolist() == [1, 0]
    assert after.state[after.contact_row].tolist() == [HELD, TOUCH]


def test_more_contacts_than_slots_are_kept_without_one_and_the_oldest_gets_the_next(film):
    rows = [(1, 0.02 + 0.05 * (n % 7), -0.15 + 0.06 * (n // 7), 20.0 - 0.1 * n) for n in range(20)]
    tracks = film.show(*rows)
    assert sorted(tracks.slot.tolist()) == [-1] * 4 + list(range(16))
    assert tracks.slot[tracks.contact_row[:16]].tolist() == list(range(16))  # the strongest are shown
    for _ in range(4):
        tracks = film.show(*rows[1:])
    waited = tracks.contact_row[15]  # contact 16 of rows
    assert tracks.slot[waited] == 0


def test_reset_forgets_tracks_but_not_which_identities_were_given(film):
    film.show((0, 0.1, 0.0))
    film.tracker.reset()
    tracks = film.show((0, 0.1, 0.0))
    assert (tracks.identity.tolist(), tracks.id.tolist(), tracks.state.tolist()) == ([2], [2], [TOUCH])


# --- Time ------------------------------------------------------------------------------------------


def test_repeated_cycle_says_nothing_new_to_the_filter(film):
    film.show((0, 0.1, 0.0))
    before = film.show((0, 0.101, 0.0))
    again = film.show((0, 0.102, 0.0), after_ns=0)
    assert again.s[0] == 0.102
    assert np.array_equal(again.mean, before.mean)
    assert np.array_equal(again.covariance, before.covariance)


def test_clock_set_back_keeps_tracks_and_their_ages(film):
    film.t_ns = 10**18
    film.show((0, 0.1, 0.0))
    before = film.show((0, 0.1, 0.0))
    film.t_ns = 10**9
    after = film.show((0, 0.1, 0.0))
    assert after.identity.tolist() == [1]
    assert after.t_ns - after.born_ns[0] == before.t_ns - before.born_ns[0]
    assert film.show((0, 0.1, 0.0)).state.tolist() == [HELD]


def test_long_gap_ends_every_track(film):
    film.show((0, 0.1, 0.0))
    tracks = film.show((0, 0.1, 0.0), after_ns=2 * 10**9)
    assert tracks.state.tolist() == [LIFT, TOUCH]


# --- Bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("column", [1, 2, 3])
def test_row_that_is_not_finite_is_left_out(film, bad, column):
    row = [0, 0.1, 0.0, 5.0]
    row[column] = bad
    film.show((0, 0.1, 0.0))
    tracks = film.show(tuple(row), (0, 0.1, 0.0))
    assert tracks.contact_row.tolist() == [-1, 0]
    assert np.isfinite(tracks.mean).all()


@pytest.mark.parametrize("variance", [np.nan, -1.0, 1e-300, 1e30])
def test_no_covariance_breaks_the_filter(film, variance):
    for _ in range(100):
        tracks = film.show((0, 0.1, 0.0), covariance=[np.diag([1e-8, variance, 1.0])])
    assert np.isfinite(tracks.mean).all()
    place, both, speed = tracks.covariance[0].T
    assert place.min() > 0.0
    assert (place * speed - both**2)[:2].min() > 0.0


def test_fresh_of_wrong_shape_is_refused(film):
    with pytest.raises(ValueError, match="shape"):
        film.tracker.update(contacts(), PERIOD_NS, np.ones(3, bool))
