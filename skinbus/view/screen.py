"""The screen of `run` and `demo`: the arm unrolled, the contacts, and how the cycle does."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import rich.console
from rich.live import Live
from rich.text import Text

from skinbus.model import Arm
from skinbus.skin.cycle import Cycle
from skinbus.view.table import contact_table
from skinbus.view.unrolled import Unrolled

REFRESH_S = 0.1
"""A screen follows ten times a second: what eyes can."""
BELOW = 6
"""Lines beside the picture: the head, some contacts, and the one with the cursor."""


class Screen:
    """Draws one cycle."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._drawn: dict[int, Unrolled] = {}

    def render(self, cycle: Cycle | None, width: int = 80, height: int = 24) -> rich.console.Group:
        """Return the screen of a terminal of this size, without the picture where there is no room for it."""
        if cycle is None:
            return rich.console.Group(Text("waiting for a cycle ...", style="yellow"))
        lost = cycle.patch_records["last_fresh_ns"] < cycle.t_ns
        head = Text(
            f"{self._arm.name}  SYNC {cycle.counter:3d}  patches {(~lost).sum()}/{len(lost)}  "
            f"contacts {len(cycle.contacts)}  latency {1e3 * cycle.latency_s:.1f} ms  level {cycle.level}",
            no_wrap=True,
            overflow="ellipsis",
        )
        parts = [head]
        if width not in self._drawn:
            self._drawn[width] = Unrolled(self._arm, width)
        unrolled = self._drawn[width]
        columns, lines = unrolled.size
        if columns <= width and lines + BELOW <= height:
            picture = unrolled.render(cycle)
            picture.rstrip()
            parts.append(picture)
        elif lost.any():
            names = ", ".join(map(self._arm.node_label, np.flatnonzero(lost).tolist()))
            parts.append(Text(f"lost boards: {names}", style="red", no_wrap=True, overflow="ellipsis"))
        return rich.console.Group(*parts, contact_table(cycle.contacts))


@contextmanager
def live_screen(
    console: rich.console.Console, arm: Arm, *, is_wanted: bool = True
) -> Iterator[Callable[[Cycle | None], None]]:
    """Yield what shows a cycle, at the pace of the eye; without a terminal it does nothing."""
    if not (is_wanted and console.is_terminal):
        yield lambda cycle: None
        return
    screen, next_s = Screen(arm), 0.0

    def show(cycle: Cycle | None) -> None:
        nonlocal next_s
        if (now_s := time.monotonic()) >= next_s:
            next_s = now_s + REFRESH_S
            live.update(screen.render(cycle, *console.size), refresh=True)

    with Live(console=console, auto_refresh=False) as live:
        yield show
