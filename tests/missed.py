"""Limits that the estimator misses today: each test stays as it is and may fail until it is met."""

NOISE = "under noise of 20 kPa a contact is 64-69 mm off and reports 13-41 mm"
MISSED = {
    "tests/hard/test_catalogue.py::test_what_must_hold_holds[noise above the signal-fit]": NOISE,
    "tests/hard/test_catalogue.py::test_what_must_hold_holds[noise above the signal-full]": NOISE,
    "tests/estimate/calibration/test_response.py::"
    "test_contacts_between_coarse_tactels_are_true_within_what_they_claim[fit]": "1.3 % beyond, 1 % asked",
    "tests/estimate/calibration/test_response.py::"
    "test_contacts_between_coarse_tactels_are_true_within_what_they_claim[full]": "2.7 % beyond, 1 % asked",
    "tests/estimate/test_contacts.py::"
    "test_two_fingers_across_a_seam_are_not_one_of_the_force_of_one_without_a_flag[places2]": (
        "the weaker finger is 6 N off, not 1"
    ),
    "tests/estimate/test_contacts.py::"
    "test_contacts_whose_peak_is_at_full_scale_are_true_within_their_covariance": "1 % beyond, 0.5 % asked",
}


def reason_of(nodeid: str) -> str | None:
    """Return what is missed by a test, None if nothing is known to be."""
    return MISSED.get(nodeid)
