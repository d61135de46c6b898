"""Limits that are missed today: each of these tests stays as it is and may fail until its limit is met."""

NOISE = "under noise of 20 kPa a contact is 64-69 mm off and reports 13-41 mm"
FLAT = "a flat field on a frustum, radial law: the force is 10 to 25 times what rests on the board"
COARSE = "contacts between coarse tactels: 1.3 (fit) and 2.7 % (full) beyond; 1 % asked"
CLOSE = "covariance of close contacts is too small"
ZERO = "a finger that is there from the first reading on is two contacts"
FORCES = "tests/estimate/test_contacts.py::"
CATALOGUE = "tests/hard/test_catalogue.py::test_what_must_hold_holds"
RESPONSE = "tests/estimate/calibration/test_response.py::test_contacts_between_coarse_tactels_are_true_within"
ACCURACY = "tests/study/test_accuracy.py::"
COMMANDS = "tests/master/test_commands.py::test_what_presses_from_the_first_reading_on"

MISSED = {
    f"{CATALOGUE}[noise above the signal": NOISE,
    f"{CATALOGUE}[flat field of": FLAT,
    f"{CATALOGUE}[one stuck at full scale": "under a cone the place is off by 5 to 42 mm; 2 asked",
    "tests/hard/test_bytes.py::test_any_bytes_on_the_wire_give_sound_contacts_and_tracks[False-arm-40]": (
        "random bytes on 48 boards: one contact lies 26 mm off the skin"
    ),
    "tests/hard/test_oracles.py::test_no_start_of_scipy_ends_lower[full-2-radial]": "6.780 for 6.761",
    f"{FORCES}test_two_fingers_across_a_seam_are_not_one": "the weaker finger is 6 N off; 1 asked",
    f"{FORCES}test_contacts_whose_peak_is_at_full_scale": "1 % beyond; 0.5 % asked",
    f"{FORCES}test_full_counts_four_to_nine_touches_two_pitches_apart[cone]": "right in 78 %; 94 % asked",
    "tests/socketcan/test_faults.py::test_loss_while_the_reader": "1.7 % of a storm is not counted",
    "tests/hard/test_extremes.py::test_extreme_readings": "one covariance of 2258 has no positive diagonal",
    RESPONSE: COARSE,
    COMMANDS: ZERO,
    "tests/interop/test_npm_master.py::test_device_of_another_make": "a ramp is five contacts",
    "tests/planning/test_coverage.py::test_predicted_and_measured_scatter": "1.15 x; 1.1 asked",
    "tests/skin/test_simulated_covers.py::test_a_finger_is_where": "a palm over a seam is a contact too many",
    "tests/fuzz/test_fuzz_trust.py::test_boards_that_misbehave": "healthy boards are used in 98.8 %",
    "tests/master/commissioning/test_press_guide.py::test_presses_are_taken_back": "one line is not printed",
    f"{ACCURACY}test_covariance_of_contacts_close_together_is_honest": CLOSE,
    f"{ACCURACY}test_light_presses_at_a_rim": "light presses at a rim are said to be stronger",
    f"{ACCURACY}test_two_fingers_apart_across_a_seam_are_two_out_of_the_box[kmeans]": "some pairs are one",
}


def reason_of(nodeid: str) -> str | None:
    """Return what a test misses, None if nothing is known."""
    return next((reason for start, reason in MISSED.items() if nodeid.startswith(start)), None)
