"""Frames as the kernel hands them over: with and without numba they become the same."""

import numpy as np

from skinbus.bus.socketcan_batch import finish, finish_kernel
from skinbus.can.frame import FrameBatch


def finished(function, seed):
    """What a function makes of 64 messages of any content, in ten batches."""
    rng = np.random.default_rng(seed)
    batch, last_ns, dropped = FrameBatch(64), np.zeros(2, np.int64), 0
    stamped, counted = (1 << 32) * np.array([35, 40]) + 1
    for _ in range(10):
        batch.frames[:] = np.frombuffer(rng.bytes(batch.frames.nbytes), batch.frames.dtype)
        messages = np.zeros((64, 8), np.int64)
        messages[:, 5] = rng.choice([0, 32, 56], 64)
        messages[:, 7] = rng.choice([16, 72], 64)
        control = rng.integers(0, 1 << 20, (64, 8))
        control[:, 1] = rng.choice([stamped, 0], 64)
        control[:, 5] = rng.choice([counted, 0], 64)
        last_ns[1] += 10**14
        columns = [batch.frames[name] for name in ("can_id", "length", "flags", "bus")]
        dropped = function(*columns, batch.t_ns, messages, control, 64, 7, last_ns, dropped)
    return int(dropped), batch.frames.tobytes(), batch.t_ns.tolist(), messages.tolist()


def test_without_numba_frames_are_the_same():
    for seed in range(5):
        assert finished(finish, seed) == finished(finish_kernel(), seed)
