"""Lines that a person types, or that come in a pipe, without waiting for them."""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Sequence


class TypedLines:
    """Reads standard input in a thread of its own, which ends with the process."""

    def __init__(self) -> None:
        self._lines: deque[str] = deque()
        self._ended = threading.Event()
        self._stdin = sys.stdin
        threading.Thread(target=self._read, name="typed lines", daemon=True).start()

    @property
    def has_ended(self) -> bool:
        """Whether nothing will come any more: the input has ended and all of it was taken."""
        return self._ended.is_set() and not self._lines

    def take(self) -> list[str]:
        """Return the lines since the last call."""
        lines = []
        while self._lines:
            lines.append(self._lines.popleft())
        return lines

    def put_back(self, lines: Sequence[str]) -> None:
        """Have lines returned again, first."""
        self._lines.extendleft(reversed(lines))

    def _read(self) -> None:
        try:
            for line in self._stdin:
                self._lines.append(line)
        except (OSError, ValueError):  # a terminal that has gone
            pass
        finally:
            self._ended.set()
