"""The screen of `run` and `demo`: the arm unrolled, the contacts, and how the cycle does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from skinbus.estimate import TrackState
from skinbus.master.cycle_report import CycleReport
from skinbus.model import Arm
from skinbus.objects.contacts import ContactState
from skinbus.skin.listener import ContactRow
from skinbus.view.table import contact_table
from skinbus.view.unrolled import Unrolled

FULL_SHADE_PA = 60e3
"""Pressure shown darkest: the peak of a 5 N fingertip on the default layer is about 40 kPa."""


class Screen:
    """Draws one report of the master; ten times a second is enough for the eye."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._links = tuple(link.name for link in arm.links)
        self._unrolled = Unrolled(arm)

    def render(
        self, report: CycleReport | None, truth: Sequence[tuple[int, float, float, float]] = ()
    ) -> Group:
        """Return the screen; ``truth`` are true touches (link, s, a, force), where a simulator has them."""
        if report is None:
            return Group(Text("waiting for the first cycle ...", style="yellow"))
        rows = rows_of(report)
        picture = self._unrolled.render(
            report.pressures,
            FULL_SHADE_PA,
            [(row.link, row.s, row.a, str(row.id)) for row in rows],
            [(link, s, a) for link, s, a, _ in truth],
            ~report.fresh[self._arm.tactel_patch],
        )
        head = Text(
            f"{self._arm.name}   SYNC {report.counter:3d}   patches {report.n_fresh}/{self._arm.n_patches}   "
            f"contacts {len(report.contacts)}   compute {report.compute_ns / 1e3:.0f} us   "
            f"SYNC to contacts {report.latency_ns / 1e6:.1f} ms"
        )
        body: list[Text | Table] = [head, picture, contact_table(rows, self._links)]
        if truth:
            body.append(self._truth_table(truth))
        return Group(*body)

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
