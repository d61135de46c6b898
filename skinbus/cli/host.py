"""What the commands that own a core share: a thread for the core, events as text, a clean end."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self

from skinbus.bus.core_thread import CoreThread
from skinbus.can.core import Core, Step
from skinbus.cli.console import Console
from skinbus.cli.stop_signals import Ending
from skinbus.skin.addresses import BusAddress
from skinbus.view.event_log import EventLog

POLL_S = 0.2
"""How often a waiting command looks whether its core still runs."""

QUICK_S = 0.05
"""The same for one that follows a dialogue, or a core that is soon done."""


@contextmanager
def compiling(console: Console) -> Iterator[None]:
    """Say why the first start takes long, with a dot for each kernel that is compiled, on a terminal.

    Ctrl-C and SIGTERM end it between two kernels.
    """
    from skinbus.jit import on_compile  # numba: a guard does without
    from skinbus.jit.kernel_files import kernel_folder

    begin: list[float] = []

    def say() -> None:
        if ending.asked:
            raise KeyboardInterrupt
        if not begin:  # one line for all that needs it
            fault = kernel_folder().fault
            why = f"no cache: {fault}" if fault else "once, they are cached"
            console.print(f"compiling kernels ({why}): 10 s, for fit 25 s, on an idle machine")
            begin.append(time.monotonic())
        if console.is_terminal:
            console.print(".", end="")

    log = logging.getLogger("skinbus.kernels")  # it says the same to programs
    log.disabled = True
    try:
        with Ending() as ending, on_compile(say):
            yield
    finally:
        log.disabled = False
    if ending.asked:
        raise KeyboardInterrupt
    if begin:
        if console.is_terminal:
            console.print()
        console.print(f"compiled in {time.monotonic() - begin[0]:.0f} s")


def run_to_end(core: Core, place: BusAddress, say: Callable[[str], Any] = print) -> None:
    """Run a core on a bus until it stops by itself, or is asked to end."""
    with Host(core, [place], say=say) as host:
        host.wait(None, QUICK_S)


class Host:
    """Runs a core on a bus in a thread of its own while it is open; opening the bus may raise BusError.

    Meanwhile Ctrl-C and SIGTERM end a wait, and nothing else: what the core sends last always goes out.
    """

    def __init__(
        self,
        core: Core,
        places: Sequence[BusAddress],
        *,
        say: Callable[[str], Any] = print,
        urgent: bool = False,
        steady: bool = False,
        on_step: Callable[[Step], Any] | None = None,
    ) -> None:
        """Prepare to run a core.

        ``places`` are those of the core's buses. Events are shown through ``say``. With ``urgent`` the
        core's thread comes before all others; with that or ``steady`` garbage is collected in pauses only.
        ``on_step`` is called after each step of the core, in its thread.
        """
        self._say = say
        self._log = EventLog(say, [place.name or place.channel or place.interface for place in places])
        self._ending = Ending()
        self._thread = CoreThread(
            core,
            *(place.open for place in places),
            on_event=self._log.take,
            on_step=on_step,
            complain=say,
            urgent=urgent,
            steady=steady,
        )
        self.report = self._thread.report
        """What the loop did, when it has ended."""

    def __enter__(self) -> Self:
        self._ending.__enter__()
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._thread.stop()
        self._ending.__exit__(*exc)
        self._log.show(all_of_it=True)
        if self._thread.error is not None and exc[1] is None:
            raise self._thread.error

    def wait(self, seconds: float | None, poll_s: float = POLL_S, then: Callable[[], Any] = tuple) -> None:
        """Return after so many seconds (None: never), when asked to end, or when the core has ended."""
        end = time.monotonic() + seconds if seconds else float("inf")
        self.wait_until(lambda: time.monotonic() >= end, poll_s, then)

    def wait_until(self, is_over: Callable[[], bool], poll_s: float, then: Callable[[], Any]) -> None:
        """Return when ``is_over``, asked to end, or the core has ended; calls ``then`` at every look."""
        # Not by a join with a time-out: interrupted, Python 3.11 takes the thread for ended ever after.
        while not (self._ending.asked or is_over() or self._thread.ended.wait(poll_s)):
            then()
            self._log.show()
        if self._ending.asked:
            self._log.show(all_of_it=True)  # what came before comes first
            self._say("stopping")
