"""The load of a bus is the time of its frames over the last second, never less than on the wire."""

import pytest

from skinbus.can.frame import EXTENDED, Frame, FrameBatch
from skinbus.config.system import load_arm
from skinbus.skin.bus_meter import BusMeter

MS = 1_000_000


def meter():
    return BusMeter(load_arm("arm-two-buses").buses)


def test_frames_count_on_their_bus_by_their_worst_length():
    taken = meter()
    assert taken.loads(0) == (0.0, 0.0)
    for ms in range(1000):
        taken.take(Frame(0x181, bytes(8)))
        if ms % 2:
            taken.take(Frame(0x181, bytes(0), bus=1))
    assert taken.loads(1000 * MS) == pytest.approx((0.135, 0.5 * 0.055))
    assert taken.loads(1999 * MS) == pytest.approx((0.135, 0.5 * 0.055))  # of the last whole second
    assert taken.loads(2000 * MS) == (0.0, 0.0)


def test_batches_count_as_their_frames_do_and_a_29_bit_identifier_takes_longer():
    one, many, long = meter(), meter(), meter()
    batch = FrameBatch(8)
    frames = [Frame(0x181 + k, bytes(k), bus=k % 2) for k in range(8)]
    batch.extend(frames)
    for taken in (one, many, long):
        taken.loads(0)
    many.take_batch(batch)
    for frame in frames:
        one.take(frame)
        long.take(frame._replace(flags=EXTENDED))
    ones = one.loads(1000 * MS)
    assert ones == pytest.approx(many.loads(1000 * MS))
    assert long.loads(1000 * MS) == pytest.approx([load + 4 * 25e-6 for load in ones])
