"""Fault confinement: who destroys whose frame, and for how long the bus is lost."""

import pytest

from skinbus.can.arbitration import ERROR_FRAME_BITS, ERROR_PASSIVE, collide
from skinbus.can.frame import EXTENDED, RTR, Frame


def frames(*bodies, flags=0):
    return [Frame(0x181, body, flags=flags) for body in bodies]


def test_passive_loser_destroys_nothing():
    outcome = collide(frames(b"\x02", b"\x01", b"\x01"), [ERROR_PASSIVE, 0, 0])
    assert (outcome.sent, outcome.failed, outcome.bits) == ((1, 2), (0,), 0)


@pytest.mark.parametrize(
    ("bodies", "flags", "bits"),
    [
        ((b"\x00", b"\x80"), 0, 19 + 1),  # the first bit of the data
        ((b"\x00", b"\x01"), 0, 19 + 8),
        ((b"\xff\x00", b"\xff\x40"), 0, 19 + 8 + 2),
        ((b"", bytes(8)), 0, 15 + 1),  # the first bit of the length
        ((b"", b"\x00"), 0, 15 + 4),
        ((b"\x00", b"\x80"), EXTENDED, 39 + 1),
        ((b"", bytes(1)), RTR, 15 + 4),
    ],
)
def test_bus_is_lost_up_to_the_first_different_bit_and_an_error_frame(bodies, flags, bits):
    assert collide(frames(*bodies, flags=flags), [0, 0]).bits == bits + ERROR_FRAME_BITS
