"""The screen of `run` and `demo`: the arm unrolled, the contacts, and how the cycle does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from skinbus.estimate import TrackState
from skinbus.master.cycle import CycleReport
from skinbus.model import Arm
from skinbus.objects.contacts import ContactState
from skinbus.skin.listener import ContactRow
from skinbus.view.table import contact_table
from skinbus.view.unrolled import Unrolled

FULL_SHADE_PA: Final = 60e3
"""Pressure shown darkest: the peak of a 5 N fingertip on the default layer is about 40 kPa."""
LEAST_ROWS: Final = 3
"""Contacts that have room below the picture, or there is none."""


class Screen:
    """Draws one report of the master; ten times a second is enough for the eye."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._links = tuple(link.name for link in arm.links)
        self._drawn: dict[int, Unrolled] = {}

    def render(
        self,
        report: CycleReport | None,
        truth: Sequence[tuple[int, float, float, float]] = (),
        *,
        width: int = 80,
        height: int = 24,
    ) -> Group:
        """Return the screen of a terminal of this size, without the picture where there is no room for it.

        ``truth`` are true touches (link, s, a, force), where a simulator has them.
        """
        if report is None:
            return Group(Text("waiting for the first cycle ...", style="yellow"))
        rows, lost = rows_of(report), ~report.fresh
        head = Text(
            f"{self._arm.name}  SYNC {report.counter:3d}  patches {report.n_fresh}/{self._arm.n_patches}  "
            f"contacts {len(report.contacts)}  compute {report.compute_ns / 1e3:.0f} us  "
            f"latency {report.latency_ns / 1e6:.1f} ms",
            no_wrap=True,
            overflow="ellipsis",
        )
        parts: list[Text | Table] = [head]
        room = height - 3  # head, that of the contacts, and the line on which the cursor is
        unrolled = self._drawn.setdefault(width, Unrolled(self._arm, width))
        columns, lines = unrolled.size
        if columns <= width and lines + min(len(rows), LEAST_ROWS) <= room:
            picture = unrolled.render(
                report.pressures,
                FULL_SHADE_PA,
                [(row.link, row.s, row.a, str(row.id)) for row in rows],
                [(link, s, a) for link, s, a, _ in truth],
                lost[self._arm.tactel_patch],
            )
            picture.rstrip()
            parts.append(picture)
            room -= lines
        elif lost.any():
            names = ", ".join(map(self._arm.node_label, np.flatnonzero(lost).tolist()))
            parts.append(Text(f"lost boards: {names}", style="red", no_wrap=True, overflow="ellipsis"))
            room -= 1
        n_shown = len(rows) if len(rows) <= room else room - 1
        parts.append(contact_table(rows[:n_shown], self._links))
        if n_shown < len(rows):
            parts.append(Text(f"... and {len(rows) - n_shown} more", style="yellow"))
        return Group(*parts)


def rows_of(report: CycleReport) -> list[ContactRow]:
    """Return the contacts as they were published, coasting and lifted ones too, as rows to show."""
    tracks, rows = report.tracks, []
    for n in np.flatnonzero(tracks.slot >= 0).tolist():
        state = int(tracks.state[n])
        is_moving, is_lifted = state == TrackState.MOVE, state == TrackState.LIFT
        rows.append(
            ContactRow(
                slot=int(tracks.slot[n]),
                id=int(tracks.id[n]),
                link=int(tracks.link[n]),
                state=ContactState.HELD if is_moving else ContactState(state),
                s=float(tracks.s[n]),
                a=float(tracks.a[n]),
                force=0.0 if is_lifted else float(tracks.force[n]),
                t_ns=report.t_ns,
            )
        )
    return sorted(rows, key=lambda row: row.id)
