"""A callable as the source of a patch: whatever it does, no stale number is sent."""

import itertools
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from skinbus.can.clock import VirtualClock
from skinbus.gateway.reader import Reader
from tests.test_examples import EXAMPLES

MS = 1_000_000
GOOD = np.arange(16)


def raises():
    raise OSError("no acknowledge")


NUMBERS = itertools.count()
NONSENSE = [
    (raises, "OSError: no acknowledge"),
    (lambda: None, "TypeError"),
    (lambda: GOOD[:15], "shape (15,); wanted (16,)"),
    (lambda: [GOOD], "shape (1, 16)"),
    (lambda: [*GOOD[:15], "x"], "TypeError"),
    (lambda: GOOD + 1j, "TypeError"),
    (lambda: np.ma.masked_all(16), ""),
    (lambda: np.full(16, np.nan), ""),
    (lambda: np.full(16, np.inf), ""),
    (lambda: sys.exit(), "SystemExit"),
    (lambda: [*GOOD[:15], 0x8000 + next(NUMBERS)], "returned 0 to 32768; wanted -32768 to 32767"),
]


@pytest.mark.parametrize(("read", "fault"), NONSENSE)
def test_what_is_no_sample_leaves_no_healthy_tactel_until_there_is_one_again(read, fault):
    clock, said, now = VirtualClock(5 * MS), [], [lambda: GOOD]
    reader = Reader(lambda: now[0](), 16, 16, said.append)
    assert not reader.newest(5 * MS).healthy.any(), "nothing was read yet"
    reader.call(clock)
    assert reader.newest(6 * MS).healthy.all()
    now[0] = read
    for _ in range(2):
        reader.call(clock)
        assert not reader.newest(6 * MS).healthy.any()
    now[0] = lambda: GOOD
    reader.call(clock)
    sample = reader.newest(6 * MS)
    assert (sample.counts.tolist(), sample.t_ns.tolist()) == (GOOD.tolist(), [5 * MS])
    assert sample.healthy.all()
    assert [text for text in said if text] == said[:-1]
    assert [fault in text for text in said[:-1]] == [True] * bool(fault), "a fault is said once"


@pytest.mark.parametrize("read", [lambda: [np.nan, *GOOD[1:]], lambda: np.ma.array(GOOD, mask=GOOD == 0)])
def test_tactel_without_a_number_is_the_only_one_that_is_not_healthy(read):
    reader = Reader(read, 16, 16)
    reader.call(VirtualClock(0))
    assert reader.newest(0).healthy.tolist() == [False] + [True] * 15
    assert reader.newest(0).counts[1:].tolist() == GOOD[1:].tolist()


def test_thread_reads_until_it_is_stopped_and_one_that_hangs_gives_nothing_old():
    calls, hold = threading.Semaphore(0), threading.Semaphore(2)

    def read():
        calls.release()
        hold.acquire()
        return GOOD

    reader, stop, clock = Reader(read, 16, 16), threading.Event(), VirtualClock(0)
    thread = threading.Thread(target=reader.run, args=(clock, 0.0, stop), daemon=True)
    thread.start()
    for _ in range(3):
        calls.acquire(timeout=60)  # in the third call it hangs
    assert reader.newest(100 * MS).healthy.all()
    assert not reader.newest(100 * MS + 1).healthy.any()
    stop.set()
    hold.release()
    thread.join(60)
    assert not thread.is_alive()


def test_example_for_i2c_returns_what_the_converters_hold(monkeypatch):
    """On converters that are not there: each holds 1000 times its number and the channel it was asked for."""
    asked = {}

    class Bus:
        def __init__(self, number):
            assert number == 1

        def write_i2c_block_data(self, address, register, data):
            assert (register, data[1], data[0] & 0xCF) == (1, 0xE3, 0xC3)
            asked[address] = data[0] >> 4 & 3

        def read_i2c_block_data(self, address, register, n):
            assert (register, n) == (0, 2)
            return list((1000 * (address - 0x48) + asked[address] - 2).to_bytes(2, "big", signed=True))

    monkeypatch.setitem(sys.modules, "smbus2", SimpleNamespace(SMBus=Bus))
    names = {}
    exec((EXAMPLES / "i2c_pad.py").read_text(), names)
    reader = Reader(names["read"], 16, 16)
    reader.call(VirtualClock(0))
    assert reader.fault == ""
    assert reader.newest(0).counts.tolist() == [1000 * k + c - 2 for c in range(4) for k in range(4)]
