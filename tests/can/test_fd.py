"""Lengths and worst-case bits of CAN FD frames."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.can.fd import LENGTHS, frame_length, length_code, worst_case_bits


@given(st.integers(0, 64))
def test_a_frame_is_the_shortest_that_holds_the_data(n):
    assert frame_length(n) == min(length for length in LENGTHS if length >= n)
    assert LENGTHS[length_code(n)] == frame_length(n)


def test_more_than_any_frame_holds_has_no_code():
    with pytest.raises(ValueError, match=r"0\.\.64"):
        length_code(65)


def test_worst_case_of_sixteen_readings_is_the_sum_of_its_fields():
    # 30 nominal and 4 stuff bits; 5 of the header, 256 of data, 65 stuff bits, 25 of count and CRC, 7 fixed.
    assert worst_case_bits(32) == (34, 5 + 256 + 65 + 25 + 7)
    # Sixteen readings in one frame at 1 and 5 Mbit/s, against four classic frames of 135 bits.
    assert worst_case_bits(32).ns(1_000_000, 5_000_000) == 34_000 + 71_600
