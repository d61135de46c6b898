"""Limits that are missed today: each of these tests stays as it is and may fail until its limit is met.

They are named one by one, so that no other test may fail. They are not strict: some miss by little, and the
kernels that CI compiles, for any processor, round otherwise.
"""

ZERO = "a finger that is there from the first reading on is two contacts"
CONTACTS = "tests/estimate/test_contacts.py::"
COARSE = (
    "tests/estimate/calibration/test_response.py::"
    "test_contacts_between_coarse_tactels_are_true_within_what_they_claim"
)
ACCURACY = "tests/study/test_accuracy.py::"
HONEST = f"{ACCURACY}test_covariance_of_contacts_close_together_is_honest"
FROM_START = (
    "tests/master/test_commands.py::test_what_presses_from_the_first_reading_on_is_zero_only_if_so_asked"
)

MISSED = {
    **{f"{FROM_START}[{zero}]": ZERO for zero in (False, True)},
    f"{COARSE}[fit]": "1.3 % beyond; 1 % asked",
    f"{COARSE}[full]": "2.7 % beyond; 1 % asked",
    f"{HONEST}[pad-two-0.85]": "3.6; at most 1.25 asked",
    f"{HONEST}[pad-three-0.85]": "4.6; at most 1.25 asked",
    f"{HONEST}[forearm-two on seam-0.85]": "5.8; at most 1.25 asked",
    f"{HONEST}[finger-two 15 mm-0.6]": "0.594; at least 0.6 asked",
    f"{ACCURACY}test_a_layout_of_triangles_is_as_good_as_a_grid[two anywhere-150-97.0]": (
        "2.7 with these draws; at most 1.15 asked"
    ),
    f"{ACCURACY}test_two_fingers_apart_across_a_seam_are_two_out_of_the_box[kmeans]": "they are one",
    f"{CONTACTS}test_two_fingers_across_a_seam_are_not_one_of_the_force_of_one_without_a_flag[places2]": (
        "the weaker finger is 6 N off; 1 asked"
    ),
    f"{CONTACTS}test_contacts_whose_peak_is_at_full_scale_are_true_within_their_covariance": (
        "1 % beyond; 0.5 % asked"
    ),
    f"{CONTACTS}test_full_counts_four_to_nine_touches_two_pitches_apart[cone]": "right in 78 %; 94 % asked",
    f"{CONTACTS}test_full_counts_four_to_nine_touches_two_pitches_apart[radial]": (
        "right in 89 %; 94 % asked; in 93 % of three draws"
    ),
    "tests/hard/test_oracles.py::test_no_start_of_scipy_ends_lower[full-2-radial]": "6.780 for 6.761",
    "tests/planning/test_coverage.py::"
    "test_predicted_and_measured_scatter_agree_within_a_tenth[radial]": "1.15 times the bound; 1.1 asked",
    "tests/planning/test_coverage.py::"
    "test_predicted_and_measured_scatter_agree_within_a_tenth[cone]": "1.19 times the bound; 1.1 asked",
    "tests/estimate/test_baseline_noisy_start.py::"
    "test_a_press_that_grows_slowly_is_a_contact_and_stays_one[200.0-1.0]": (
        "in 83 % of the cycles in which it grows; 90 % asked: its zero is a second old"
    ),
    "tests/skin/test_simulated_covers.py::"
    "test_a_finger_is_where_it_is_in_the_world_and_a_palm_over_a_seam_is_one_contact": "the palm is two",
    "tests/socketcan/test_gateway.py::"
    "test_a_touch_of_such_a_skin_is_a_contact_on_the_bus[xela-uskin-addresses1-4-4]": (
        "on a slow CPU boards, gateway and master need more than all of it: they send 4800 frames/s"
    ),
    "tests/socketcan/test_faults.py::test_loss_while_the_reader_stands_still_is_published_to_the_frame": (
        "on a busy machine later errors push the overflow out of the four newest"
    ),
}
