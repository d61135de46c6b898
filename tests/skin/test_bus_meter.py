"""The load of a bus is the time of its frames over the last second, never less than on the wire."""

import pytest

from skinbus.can.frame import Frame, FrameBatch
from skinbus.config.system import load_arm
from skinbus.skin.bus_meter import BusMeter

MS = 1_000_000


def test_frames_count_on_their_bus_by_their_worst_length_one_by_one_or_in_batches():
    one, many = (BusMeter(load_arm("arm-two-buses").buses) for _ in range(2))
    frames = [Frame(0x181, bytes(8)), Frame(0x181, bytes(8)), Frame(0x181, bytes(0), bus=1)]
    batch = FrameBatch(8)
    batch.extend(frames)
    assert one.loads(0) == (0.0, 0.0)
    for _ in range(500):
        many.take_batch(batch)
        for frame in frames:
            one.take(frame)
    for taken in (one, many):
        assert taken.loads(1000 * MS) == pytest.approx((0.135, 0.5 * 0.055))
        assert taken.loads(1999 * MS) == pytest.approx((0.135, 0.5 * 0.055))  # of the last whole second
        assert taken.loads(2000 * MS) == (0.0, 0.0)
