"""What every interface to a bus is: frames of the data plane in batches, all others one by one."""

from __future__ import annotations

import errno
from collections.abc import Sequence
from typing import Self

from skinbus.can.event import Event
from skinbus.can.frame import ERROR, FD, MAX_DATA, CobIds, Frame, FrameBatch, Frames

SEND_PATIENCE_S = 0.1
"""How long a full send queue is waited for before frames are given up; 800 frames at 1 Mbit/s."""
RETRY_S = 0.0005
"""Between two attempts to send: four frame times at 1 Mbit/s."""
BAD_FRAME = {errno.EINVAL, errno.EMSGSIZE}
"""Errors of a frame that will never be sent."""


class Bus:
    """An open interface; frames of the data plane come as a batch, all others one by one.

    The defaults are those of an interface that can neither be waited for nor detects faults.
    """

    gives_up_in_order: bool = False
    """Whether ``send`` discards all that follows the first frame it cannot send."""

    fd: bool = False
    """Whether CAN FD frames may be sent and are received."""

    batch: FrameBatch
    """Frames of the data plane that the last ``receive`` found."""

    def listen(self, cob_ids: CobIds | None, data_ids: CobIds = frozenset()) -> None:
        """Receive these identifiers only (None: all), of them ``data_ids`` into the batch.

        Raises:
            BusError: the interface is down or gone.
        """
        raise NotImplementedError

    def receive(self, timeout_s: float = 0.0) -> Frames:
        """Return all frames that are there, waiting at most ``timeout_s`` for the first of either path.

        Raises:
            BusError: the interface is down or gone.
        """
        raise NotImplementedError

    def send(self, frames: Frames) -> int:
        """Send frames in this order; return how many were sent.

        Raises:
            BusError: the interface is down or gone.
        """
        raise NotImplementedError

    def descriptors(self, *, for_data: bool = True) -> Sequence[int]:
        """Return descriptors that become readable with frames, those of the data plane only if wanted."""
        return ()

    def news(self) -> Sequence[Event]:
        """Return the faults of the bus that were detected since the last call, and their ends."""
        return ()

    def close(self) -> None:
        """Release the interface; BusError if that fails."""

    def fits(self, frame: Frame) -> bool:
        """Return whether this interface can carry a frame."""
        if frame.flags & FD:
            return self.fd and len(frame.data) <= MAX_DATA
        return len(frame.data) <= 8 and not frame.flags & ERROR

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def advice(code: int | None) -> str:
    """Return what to do about an interface that the system does not let us open, "" where it is not known."""
    if code == errno.EAFNOSUPPORT:
        return "; the kernel of this machine has no CAN (try --interface udp_multicast)"
    return "; this user may not open it" if code in (errno.EPERM, errno.EACCES) else ""
