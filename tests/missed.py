"""Limits that are missed today: each of these tests stays as it is and may fail until its limit is met.

They are named one by one, so that no other test may fail. They are not strict: some miss by little, and the
kernels that CI compiles, for any processor, round otherwise.
"""

COARSE = (
    "tests/estimate/calibration/test_response.py::"
    "test_contacts_between_coarse_tactels_are_true_within_what_they_claim"
)

MISSED = {
    f"{COARSE}[fit]": "2.3 % beyond; 1 % asked",
    f"{COARSE}[full]": "1 % are 3 mm off; less asked",
    "tests/estimate/test_plausibility.py::"
    "test_dead_tactel_is_named_within_ten_touches_of_its_neighbourhood[at an edge]": (
        "23 of 24 are; 24 asked: with more looks in a cycle healthy tactels are named"
    ),
    "tests/estimate/test_plausibility.py::"
    "test_dead_tactel_is_named_within_ten_touches_of_its_neighbourhood[a row inside]": (
        "62 % of rows are, of 64 boards; 70 % asked"
    ),
    **{
        f"tests/hard/test_catalogue.py::test_what_must_hold_holds[three in a row-{level}]": (
            "readings that no touch makes: 19 mm off, flagged, with a deviation of 30 mm; 15 mm asked"
        )
        for level in ("fit", "full")
    },
    "tests/estimate/test_baseline_noisy_start.py::"
    "test_a_press_that_grows_slowly_is_a_contact_and_stays_one[200.0-1.0]": (
        "in 83 % of the cycles in which it grows; 90 % asked: its zero is a second old"
    ),
    "tests/socketcan/test_gateway.py::"
    "test_a_touch_of_such_a_skin_is_a_contact_on_the_bus[xela-uskin-addresses1-4-4]": (
        "on a slow CPU boards, gateway and master need more than all of it: they send 4800 frames/s"
    ),
    "tests/socketcan/test_faults.py::test_loss_while_the_reader_stands_still_is_published_to_the_frame": (
        "on a busy machine later errors push the overflow out of the four newest"
    ),
}
