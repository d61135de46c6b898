"""Contacts in frames, byte by byte; what does not fit saturates, and NaN is zero."""

import numpy as np
import pytest

from skinbus.objects.contacts import ContactState, pack_contacts, pack_deviations

# id, link, state, s m, a m, force N, data
TABLE = [
    (0, 0, ContactState.NONE, 0.0, 0.0, 0.0, "0000 0000 0000 0000"),
    (7, 2, ContactState.HELD, 0.1234, -0.0001, 5.0, "0722 d204 ffff f401"),
    (255, 15, ContactState.LIFT, 3.2767, -3.2768, 655.35, "ff3f ff7f 0080 ffff"),
    (1, 0, ContactState.TOUCH, 0.0001, 0.0, 0.01, "0110 0100 0000 0100"),
    (1, 0, ContactState.TOUCH, 10.0, np.inf, 1e9, "0110 ff7f ff7f ffff"),
    (2, 0, ContactState.TOUCH, -10.0, -np.inf, -1.0, "0210 0080 0080 0000"),
    (3, 0, ContactState.TOUCH, np.nan, 0.0, np.nan, "0310 0000 0000 0000"),
]


@pytest.mark.parametrize(("id", "link", "state", "s", "a", "force", "data"), TABLE)
def test_table_packs(id, link, state, s, a, force, data):
    payload = pack_contacts(id=id, link=link, state=state, s=s, a=a, force=force)
    assert payload.tobytes() == bytes.fromhex(data)


# variance of s (mm2), of a, covariance, variance of force (N2): counts of place and force
DEVIATIONS = [
    (1.0, 0.25, 0.0, 0.01, 10, 2),
    (0.01, 4.0, 0.0, 0.0101, 20, 3),  # rounded up
    (2.5, 2.5, 1.5, 1.0, 20, 20),  # the longer axis is oblique
    (1e6, 1.0, 0.0, 1e6, 255, 255),
    (np.inf, np.inf, 0.0, np.nan, 255, 255),
    (0.0, 0.0, 0.0, 0.0, 255, 255),  # nothing is known
]


@pytest.mark.parametrize(("ss", "aa", "sa", "ff", "place", "force"), DEVIATIONS)
def test_deviations_are_not_understated(ss, aa, sa, ff, place, force):
    covariance = np.diag([1e-6 * ss, 1e-6 * aa, ff])
    covariance[0, 1] = covariance[1, 0] = 1e-6 * sa
    assert [int(column[0]) for column in pack_deviations(covariance[None])] == [place, force]
