"""The screen of `run` and `demo`: the arm unrolled, the contacts, and how the cycle does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
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

FULL_SHADE_PA = 60e3
"""Pressure shown darkest: the peak of a 5 N fingertip on the default layer is about 40 kPa."""


NARROW: Final = 80
LOW: Final = 24
"""The smallest terminal there is: characters and lines."""


LEAST_ROWS: Final = 3
"""Contacts that have room beside the picture, or there is a list in its place."""
LIST_LINES: Final = 6
PRESSED_PA: Final = 2e3
"""From which pressure on a board is listed: twice the usual threshold."""


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
        width: int = NARROW,
        height: int = LOW,
    ) -> Group:
        """Return the screen of a terminal of this size; the picture is a list where there is no room for it.

        ``truth`` are true touches (link, s, a, force), where a simulator has them.
        """
        if report is None:
            return Group(Text("waiting for the first cycle ...", style="yellow"))
        rows = rows_of(report)
        lost = ~report.fresh
        head = Text(
            f"{self._arm.name}  SYNC {report.counter:3d}  patches {report.n_fresh}/{self._arm.n_patches}  "
            f"contacts {len(report.contacts)}  compute {report.compute_ns / 1e3:.0f} us  "
            f"latency {report.latency_ns / 1e6:.1f} ms",
            no_wrap=True,
            overflow="ellipsis",
        )
        unrolled = self._drawn.setdefault(width, Unrolled(self._arm, width))
        room = height - 3  # head, that of the contacts, and the line on which the cursor is
        columns, lines = unrolled.size
        if columns <= width and lines + min(len(rows), LEAST_ROWS) <= room:
            body: Text = unrolled.render(
                report.pressures,
                FULL_SHADE_PA,
                [(row.link, row.s, row.a, str(row.id)) for row in rows],
                [(link, s, a) for link, s, a, _ in truth],
                lost[self._arm.tactel_patch],
            )
            body.rstrip()
            room -= lines
        else:
            body = self._list(report.pressures, lost)
            body.truncate(width * LIST_LINES)
            room -= LIST_LINES
        parts: list[Text | Table] = [head, body]
        n_more = len(rows) - room
        if n_more > 0:
            rows, room = rows[: room - 1], 0
        parts.append(contact_table(rows, self._links))
        if n_more > 0:
            parts.append(Text(f"... and {n_more + 1} more", style="yellow"))
        elif truth and len(rows) + len(truth) + 1 <= room:
            parts.append(self._truth_table(truth))
        return Group(*parts)

    def _list(self, pressures: npt.NDArray[np.float64], lost: npt.NDArray[np.bool_]) -> Text:
        """Return the boards that are lost, and those that are pressed, with their largest pressures."""
        arm = self._arm
        most = np.maximum.reduceat(np.where(np.isfinite(pressures), pressures, 0.0), arm.patch_start[:-1])
        text = Text("lost boards: ")
        text.append(self._names(np.flatnonzero(lost)) or "none", style="red" if lost.any() else "green")
        pressed = np.flatnonzero((most > PRESSED_PA) & ~lost)
        text.append("\npressed, kPa: ")
        ordered = pressed[np.argsort(-most[pressed])].tolist()
        text.append(", ".join(f"{self._names([p])} {1e-3 * most[p]:.0f}" for p in ordered) or "none")
        return text

    def _names(self, patches: Iterable[int]) -> str:
        return ", ".join(map(self._arm.node_label, patches))

    def _truth_table(self, truth: Sequence[tuple[int, float, float, float]]) -> Table:
        table = Table(box=None, pad_edge=False, header_style="magenta", title_justify="left")
        for name in ("truth +", "link", "s mm", "a mm", "force N"):
            table.add_column(name, justify="right")
        for link, s, a, force in truth:
            surface = self._arm.links[link].surface
            values = (s * 1e3, float(surface.wrap(a)) * 1e3)
            table.add_row("", self._links[link], *(f"{v:.1f}" for v in values), f"{force:.2f}")
        return table


def rows_of(report: CycleReport) -> list[ContactRow]:
    """Return the contacts as they were published, coasting and lifted ones too, as rows to show."""
    tracks = report.tracks
    return [
        ContactRow(
            slot=int(tracks.slot[n]),
            id=int(tracks.id[n]),
            link=int(tracks.link[n]),
            state=published_state(int(tracks.state[n])),
            s=float(tracks.s[n]),
            a=float(tracks.a[n]),
            force=0.0 if tracks.state[n] == TrackState.LIFT else float(tracks.force[n]),
            t_ns=report.t_ns,
        )
        for n in np.argsort(tracks.id)
        if tracks.slot[n] >= 0
    ]


def published_state(state: int) -> ContactState:
    """Return what a contact TPDO says for the state of a track."""
    return ContactState.HELD if state == TrackState.MOVE else ContactState(state)
