"""The screen of `run` and `demo`: the arm unrolled, the contacts, and how the cycle does."""

from __future__ import annotations

from typing import Final

import numpy as np
from rich.console import Group
from rich.text import Text

from skinbus.model import Arm
from skinbus.skin.cycle import Cycle
from skinbus.view.table import contact_table
from skinbus.view.unrolled import Unrolled

FULL_SHADE_PA: Final = 60e3
"""Pressure shown darkest: the peak of a 5 N fingertip on the default layer is about 40 kPa."""
BELOW: Final = 6
"""Lines beside the picture: the head, some contacts, and the one with the cursor."""


class Screen:
    """Draws one cycle; ten times a second is enough for the eye."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._links = [link.name for link in arm.links]
        self._drawn: dict[int, Unrolled] = {}

    def render(self, cycle: Cycle | None, width: int = 80, height: int = 24) -> Group:
        """Return the screen of a terminal of this size, without the picture where there is no room for it."""
        if cycle is None:
            return Group(Text("waiting for the first cycle ...", style="yellow"))
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
            picture = unrolled.render(
                cycle.readings.pressures,
                FULL_SHADE_PA,
                [(self._links.index(one.link), one.s, one.a, str(one.id)) for one in cycle.contacts],
                [(self._links.index(touch.link), touch.s, touch.a) for touch in cycle.truth],
                lost[self._arm.tactel_patch],
            )
            picture.rstrip()
            parts.append(picture)
        elif lost.any():
            names = ", ".join(map(self._arm.node_label, np.flatnonzero(lost).tolist()))
            parts.append(Text(f"lost boards: {names}", style="red", no_wrap=True, overflow="ellipsis"))
        return Group(*parts, contact_table(cycle.contacts))
