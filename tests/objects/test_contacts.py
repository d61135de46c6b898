"""Contacts in frames: one table run both ways; what does not fit saturates."""

import numpy as np
import pytest

from skinbus.objects.contacts import ContactState, pack_contacts, pack_deviations
from tests.packing import unpack_contacts

# id, link, state, s m, a m, force N, data
TABLE = [
    (0, 0, ContactState.NONE, 0.0, 0.0, 0.0, "0000 0000 0000 0000"),
    (7, 2, ContactState.HELD, 0.1234, -0.0001, 5.0, "0722 d204 ffff f401"),
    (255, 15, ContactState.LIFT, 3.2767, -3.2768, 655.35, "ff3f ff7f 0080 ffff"),
    (1, 0, ContactState.TOUCH, 0.0001, 0.0, 0.01, "0110 0100 0000 0100"),
]


@pytest.mark.parametrize(("id", "link", "state", "s", "a", "force", "data"), TABLE)
def test_table_packs(id, link, state, s, a, force, data):
    payload = pack_contacts(id=id, link=link, state=state, s=s, a=a, force=force)
    assert payload.tobytes() == bytes.fromhex(data)
    columns = unpack_contacts(payload)
    assert (columns.id[0], columns.link[0], columns.state[0]) == (id, link, state)


def test_what_does_not_fit_saturates_and_nan_reads_as_zero():
    payloads = pack_contacts(
        id=[1, 2, 3],
        link=[0, 0, 0],
        state=[1, 1, 1],
        s=[10.0, -10.0, np.nan],
        a=[np.inf, -np.inf, 0.0],
        force=[1e9, -1.0, np.nan],
    )
    columns = unpack_contacts(payloads)
    assert columns.s == pytest.approx([3.2767, -3.2768, 0.0])
    assert columns.a == pytest.approx([3.2767, -3.2768, 0.0])
    assert columns.force == pytest.approx([655.35, 0.0, 0.0])


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
