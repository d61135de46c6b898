"""A core on its buses, run by a thread of its own until it is stopped; what it sends last always goes out."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

from skinbus.bus.interface import Bus
from skinbus.bus.loop import Loop
from skinbus.bus.realtime import GcScheduler, take_priority
from skinbus.can.core import Core


class CoreThread:
    """Opens the buses of a core at once, which may raise BusError; ``start`` and ``stop`` follow."""

    def __init__(
        self,
        core: Core,
        *open_buses: Callable[[], Bus],
        on_end: Callable[[BaseException | None], object] | None = None,
        complain: Callable[[str], object] = lambda text: None,
        urgent: bool = False,
        steady: bool = False,
        **options: Any,
    ) -> None:
        """Open the buses.

        on_end        called by the thread at its end, with the error that ended it
        urgent        the thread comes before all others; ``complain`` gets why not, where that is refused
        steady        garbage is collected in pauses only; it is so with ``urgent``, too
        options       those of ``Loop``
        """
        self.error: BaseException | None = None
        self.ended = threading.Event()
        self._on_end, self._complain, self._urgent = on_end, complain, urgent
        self._steady = steady or urgent
        self._stop = threading.Event()
        self._loop = Loop(core, open_buses, self._stop, **options)
        self.report = self._loop.report
        self._thread = threading.Thread(target=self._run, name="skinbus", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the core and wait for its end; a second call does nothing."""
        self._stop.set()
        self.ended.wait()
        self._thread.join()

    def _run(self) -> None:
        try:
            with GcScheduler() if self._steady else nullcontext() as self._loop.tidy:
                for complaint in take_priority() if self._urgent else ():
                    self._complain(complaint)
                self._loop.run()
        except BaseException as error:  # noqa: BLE001 - handed to the thread that waits
            self.error = error
        finally:
            self.ended.set()
            if self._on_end:
                self._on_end(self.error)
