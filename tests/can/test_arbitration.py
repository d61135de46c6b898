"""Fault confinement: who destroys whose frame."""

from skinbus.can.arbitration import ERROR_PASSIVE, collide
from skinbus.can.frame import Frame


def test_passive_loser_destroys_nothing():
    frames = [Frame(0x181, body) for body in (b"\x02", b"\x01", b"\x01")]
    assert collide(frames, [ERROR_PASSIVE, 0, 0]) == ([1, 2], [0], 0)
