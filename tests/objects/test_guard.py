"""Guard limits as bytes, in both directions."""

import numpy as np
import pytest

from skinbus.objects.guard import NO_LIMIT, GuardLimits

# By hand from the layout; the CRC with a bitwise division by 0x11021.
BYTES = bytes.fromhex("0203 40420f00 e803 ff7f 0001 0000 f6ff 0700")
LIMITS = GuardLimits(2, 3, 1_000_000, np.array([1000, NO_LIMIT]), np.array([256, 0]), np.array([-10, 7]))


def crc_by_bits(data):
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return value.to_bytes(2, "little")


def test_limits_are_these_bytes_and_their_checksum():
    assert LIMITS.encode() == BYTES + crc_by_bits(BYTES)


def test_bytes_are_these_limits():
    decoded = GuardLimits.decode(BYTES + crc_by_bits(BYTES), 2)
    assert (decoded.n, decoded.m, decoded.sum_limit) == (2, 3, 1_000_000)
    assert decoded.limits.tolist() == [1000, NO_LIMIT]
    assert decoded.weights.tolist() == [256, 0]
    assert decoded.rest.tolist() == [-10, 7]


@pytest.mark.parametrize(
    "body",
    [
        BYTES[:-1],
        BYTES + b"\0",
        b"",
        b"\0" + BYTES[1:],
        b"\4" + BYTES[1:],
        b"\2\x09" + BYTES[2:],
        BYTES[:13] + b"\4" + BYTES[14:],
    ],
)
def test_limits_of_wrong_length_or_value_are_refused(body):
    with pytest.raises(ValueError, match=r"wanted|samples"):
        GuardLimits.decode(body + crc_by_bits(body), 2)


@pytest.mark.parametrize("k", range(16))
def test_one_wrong_bit_is_refused(k):
    data = bytearray(BYTES + crc_by_bits(BYTES))
    data[k % len(data)] ^= 1 << k % 8
    with pytest.raises(ValueError, match="checksum"):
        GuardLimits.decode(bytes(data), 2)
