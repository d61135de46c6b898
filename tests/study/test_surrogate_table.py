"""The table of surrogates: figures that miss a limit are named, in the table and in the list."""

import numpy as np

from skinbus.study.surrogate_table import SurrogateErrors, missed_surrogates, write_surrogates

GOOD = SurrogateErrors(np.full(100, 0.2), np.linspace(0.95, 1.05, 100), np.ones(100))
FAR = SurrogateErrors(
    np.where(np.arange(100) < 10, 4.0, 0.2), np.linspace(0.95, 1.05, 100), np.full(100, 3.0)
)


def test_good_array_misses_nothing():
    assert missed_surrogates({(9.9, 300, "fit"): GOOD}) == []
    assert "missed" not in write_surrogates({(9.9, 300, "fit"): GOOD})


def test_far_contacts_and_a_covariance_too_small_are_missed():
    lines = missed_surrogates({(9.9, 300, "full"): FAR})
    for name in ("mean mm", "p95", "over 3 mm", "NEES"):
        assert any(name in line for line in lines), name
    assert not any("cv of force" in line for line in lines)
    assert write_surrogates({(9.9, 300, "full"): FAR}).count("**missed**") == 3


def test_contact_that_is_not_found_is_an_infinite_error():
    lost = SurrogateErrors(np.array([0.1, np.inf]), np.array([1.0, np.inf]), np.array([1.0, np.inf]))
    with np.errstate(invalid="ignore"):
        assert any("mean mm inf" in line for line in missed_surrogates({(9.9, 300, "fit"): lost}))
