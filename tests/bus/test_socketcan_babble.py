"""Who babbles: one identifier with more than half of the frames, and only that."""

import pytest

from skinbus.bus.socketcan_babble import N_LEAST, loudest


@pytest.mark.parametrize(
    ("ids", "found"),
    [
        ([0x333] * 20, 0x333),
        ([0x333] * 11 + list(range(0x181, 0x18B)), 0x333),
        ([0x601, 0x581] * 20, None),  # an SDO transfer
        (list(range(0x181, 0x1E1)), None),  # the readings of a cycle
        ([0x333] * (N_LEAST - 1), None),
        ([], None),
    ],
)
def test_one_identifier_with_more_than_half_of_the_frames_babbles(ids, found):
    assert loudest(ids)[0] == found
