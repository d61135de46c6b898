"""Follows a skin in a thread of its own: every cycle is counted, the newest one is drawn."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

from skinbus.skin.cycle import Cycle
from skinbus.skin.skin import Skin
from skinbus.view.web.history import History

PATIENCE_S: Final = 2.0
"""How long the end of the thread is waited for."""


class Follower:
    """The newest cycle of a source and the history of all; drawing never waits for it, nor it for drawing."""

    def __init__(self, opening: Callable[[], Skin], *, again_s: float | None = None) -> None:
        """Open the source and begin to follow; ``close`` ends it.

        opening:  opens the source
        again_s:  when it has ended it is opened again after so long, s; None: then it is over
        """
        self.history = History()
        self.n_cycles = 0
        """Cycles that came."""
        self.n_opened = 1
        self.error: Exception | None = None
        """What has ended the source, if that was an error; None again when it is back."""
        self._opening = opening
        self._again_s = again_s
        self._skin = opening()
        self._newest: Cycle | None = None
        self._came_s = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="skinbus-view", daemon=True)
        self._thread.start()

    @property
    def newest(self) -> Cycle | None:
        """The newest cycle; None before the first."""
        return self._newest

    @property
    def silent_s(self) -> float:
        """Time since the newest cycle came, s."""
        return time.monotonic() - self._came_s

    @property
    def has_ended(self) -> bool:
        """Whether no more cycles will come."""
        return not self._thread.is_alive()

    def zero(self, patch: int | None) -> None:
        """Have the source take new zeros; as :meth:`Skin.zero`."""
        self._skin.zero(patch)

    def close(self) -> None:
        """End the source and the thread."""
        self._stop.set()
        self._skin.close()
        self._thread.join(PATIENCE_S)

    def _run(self) -> None:
        """Follow one source after the other."""
        while not self._stop.is_set():
            try:
                if self.n_opened > 1:
                    self._skin = self._opening()
                self.error = None
                self._follow()
            except Exception as error:  # noqa: BLE001 - shown on the page
                self.error = error
            if self._again_s is None or self._stop.wait(self._again_s):
                return
            self._skin.close()
            self.n_opened += 1

    def _follow(self) -> None:
        for cycle in self._skin:
            self.n_cycles += 1
            self.history.take(cycle)
            self._newest = cycle
            self._came_s = time.monotonic()
