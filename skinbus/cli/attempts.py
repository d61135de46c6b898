"""A start that cannot succeed yet waits in the process: a restart each time costs a second of CPU."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any, Final, TypeVar

from skinbus.cli.notify import Notifier
from skinbus.cli.stop_signals import Ending
from skinbus.errors import BusError

FIRST_PAUSE_S: Final = 0.5
LONGEST_PAUSE_S: Final = 5.0
"""An attempt takes about a millisecond: 0.02 % of a processor."""
POLL_S: Final = 0.1

T = TypeVar("T")


class Attempts:
    """Tries what may raise BusError; without ``waits`` only once."""

    def __init__(
        self,
        notifier: Notifier,
        say: Callable[[str], Any],
        *,
        waits: bool,
        sleep: Callable[[float], Any] = time.sleep,
    ) -> None:
        self._notifier = notifier
        self._say = say
        self._waits = waits
        self._sleep = sleep

    def until_done(self, attempt: Callable[[], T]) -> T:
        """Return what an attempt returns, at last; ends the process with 1 if it is asked to end before."""
        if not self._waits:
            return attempt()
        pause_s, said = FIRST_PAUSE_S, ""
        with Ending() as ending:
            while not ending.asked:
                try:
                    return attempt()
                except BusError as error:
                    if str(error) != said:
                        said = str(error)
                        self._say(f"waiting: {said}")
                    self._notifier.waiting(said, pause_s)
                left_s = pause_s
                while left_s > 0.0 and not ending.asked:
                    self._sleep(min(POLL_S, left_s))
                    left_s -= POLL_S
                pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
        sys.exit(1)
