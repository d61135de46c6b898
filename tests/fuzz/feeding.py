"""Frames fed to a core one by one, for as long as its answers are frames and its memory stays as it is."""

import ctypes
import gc
import sys

N_FRAMES, CHUNK = 20_000, 10_000
"""Frames in all, and between two looks at state and memory."""
MAX_OUT = 4096
"""Frames that may be sent in answer to one frame and the time before it."""


class Memory(ctypes.Structure):
    """What ``mallinfo2`` of the GNU C library returns."""

    _fields_ = (("numbers", ctypes.c_size_t * 10),)


ask_memory = ctypes.CDLL(None).mallinfo2
ask_memory.restype = Memory


def feed(core, n_frames, frames, after_chunk, *, least_id, max_growth, hear=lambda out: None):
    """Feed a core; return how many frames it sent, and the time at the end, ns.

    AssertionError says what broke, after how many frames.

    Args:
        core: is stepped once for each frame.
        n_frames: in all.
        frames: makes so many frames, each with the time since the one before, ns.
        after_chunk: checks the state after each ``CHUNK``.
        least_id: the lowest identifier that may be sent.
        max_growth: bytes that the core may come to hold.
        hear: takes what is sent.
    """
    assert not sys.getallocatedblocks(), "wanted PYTHONMALLOC=malloc: else Python's own blocks are not seen"
    now_ns = fed = sent = base = 0
    try:
        while fed < n_frames:
            n = min(CHUNK, n_frames - fed)
            for elapsed_ns, frame in frames(n):
                now_ns += elapsed_ns
                out, events, wake_ns = core.step(now_ns, (frame,))
                sent += len(out)
                hear(out)
                assert max(len(out), len(events)) <= MAX_OUT
                assert wake_ns >= 0
                for answer in out:
                    assert least_id <= answer.can_id < 0x800
                    assert len(answer.data) <= 8
                    assert type(answer.data) is bytes
            fed += n
            after_chunk()
            del frame, out, events
            gc.collect()
            held = sum(ask_memory().numbers[4:8:3])  # bytes mapped, and bytes in use of the heap
            base = base or held
            assert held - base < max_growth, f"{held - base} bytes more than at the start, after {fed} frames"
    except Exception as error:
        error.add_note(f"within {CHUNK} frames after {fed}")
        raise
    return sent, now_ns
