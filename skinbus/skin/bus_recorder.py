"""Records the buses of an arm, with marks, while something else goes on: a thread of its own."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from skinbus.bus.core_thread import CoreThread
from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.bus.recorder import Recorder
from skinbus.can.candump import CandumpWriter
from skinbus.errors import SkinbusError
from skinbus.skin.addresses import BusAddress, open_to_listen


class BusRecorder:
    """Begins and ends recordings of buses; one at a time."""

    def __init__(self, places: Sequence[BusAddress], folder: Path) -> None:
        """Recordings go to ``folder``, under names made of date and time."""
        self._places = places
        self._folder = folder
        self._clock = MonotonicClock()
        self._writer: CandumpWriter | None = None
        self._thread: CoreThread | None = None
        self.path: Path | None = None
        """Where the last recording is, or the one that goes on."""
        self.n_marks = 0
        """Marks in it."""

    @property
    def is_recording(self) -> bool:
        """Whether one goes on."""
        return self._writer is not None

    @property
    def n_frames(self) -> int:
        """Frames in the recording that goes on."""
        return self._writer.n_frames if self._writer else 0

    def start(self) -> Path:
        """Begin a recording, and return where it is.

        Raises:
            SkinbusError: one goes on already, or the file cannot be made.
            BusError: a bus cannot be opened.
        """
        if self._writer is not None:
            raise SkinbusError(f"{self.path} is being recorded")
        path = self._folder / time.strftime("skinbus-%Y-%m-%d_%H%M%S.log")
        names = [place.channel or place.interface for place in self._places]
        try:
            writer = CandumpWriter(path, channels=names, clock=self._clock)
        except OSError as error:
            raise SkinbusError(f"{path}: {error.strerror}") from error
        recorder = Recorder(writer, len(self._places))
        try:
            thread = CoreThread(
                recorder, *(partial(open_to_listen, place) for place in self._places), steady=False
            )
        except SkinbusError:
            writer.close()
            path.unlink()
            raise
        self._writer, self._thread, self.path, self.n_marks = writer, thread, path, 0
        thread.start()
        return path

    def mark(self) -> int:
        """Write a mark of now into the recording, and return its number; SkinbusError if none goes on."""
        if self._writer is None:
            raise SkinbusError("nothing is being recorded")
        self.n_marks += 1
        self._writer.mark(self.n_marks, self._clock.now_ns())
        return self.n_marks

    def stop(self) -> None:
        """End the recording; a second call does nothing."""
        thread, writer = self._thread, self._writer
        self._thread = self._writer = None
        if thread is not None:
            thread.stop()
        if writer is not None:
            writer.close()
