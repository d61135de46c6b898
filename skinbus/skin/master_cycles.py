"""Cycles of a master of this process: what it reports, as programs see it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from skinbus.estimate import LEVELS, TrackState
from skinbus.master import CycleReport, Master
from skinbus.model import Arm
from skinbus.skin.contact import CONTACT, UNKNOWN_LEVEL, Context, Placed, Records
from skinbus.skin.cycle import PATCH, Cycle, Readings, SkinLayout, fill_places
from skinbus.skin.feed import MadeFeed, PacedFeed
from skinbus.skin.skin import Skin


class CycleMaker:
    """Makes cycles of the reports of a master; to be called by its ``on_cycle``, or before its next step."""

    now_ns: Callable[[], int] | None = None
    """Time on the clock of the reports, for ages; without it they are as of the end of the cycle."""

    def __init__(self, arm: Arm) -> None:
        self.layout = SkinLayout.of(arm)
        self._arm = arm
        self._number = 0
        self._before: Records = np.zeros(0, CONTACT)

    def make(self, master: Master, report: CycleReport) -> Cycle:
        """Return the next cycle."""
        self._number += 1
        table, ended_ns = master.table, report.t_ns + report.latency_ns
        patches = np.zeros(len(table.state), PATCH)
        patches["state"], patches["emcy"] = table.state, table.error
        patches["last_fresh_ns"] = table.last_fresh
        self._before = records = _records(report, self._before)
        fill_places(records, self._arm)
        place = partial(Placed, report.robot, report.tracks.row) if report.robot else None
        return Cycle(
            self._number,
            report.t_ns,
            report.counter,
            report.level,
            report.flags,
            1e-9 * report.latency_ns,
            Context(self.layout, self.now_ns or (lambda: ended_ns), place),
            records,
            patches,
            Readings(report.pressures, master.cycle.valid, master.cycle.plausibility.faults.copy()),
            budget_us=math.inf if report.budget_us is None else report.budget_us,
        )


def _records(report: CycleReport, before: Records) -> Records:
    """Return contacts without their places in space; those not seen are as they were last seen."""
    tracks, contacts = report.tracks, report.contacts
    records, is_seen = np.zeros(len(tracks), CONTACT), tracks.row >= 0
    records["level"] = UNKNOWN_LEVEL
    for n in np.flatnonzero(~is_seen):
        for last in before[before["identity"] == tracks.identity[n]]:
            records[n] = last
    for name in ("identity", "seen_ns", "id", "link", "state", "s", "a"):
        records[name] = getattr(tracks, name)
    records["force"] = np.where(tracks.state == TrackState.LIFT, 0.0, tracks.force)
    rows = tracks.row[is_seen]
    records["quality"][is_seen] = contacts.quality[rows]
    records["level"][is_seen] = [LEVELS.index(level) for level in contacts.level[rows]]
    records["covariance"][is_seen] = contacts.covariance[rows]
    records["has_covariance"][is_seen] = contacts.covariance[rows, 2, 2] > 0.0
    return records


def played(what: str, cycles: Iterator[Cycle], maker: CycleMaker, master: Master, *, realtime: bool) -> Skin:
    """Return the skin of a source of its own time, which in real time goes on with the machine's clock."""
    if not realtime:
        return Skin(MadeFeed(maker.layout, what, cycles, master))
    paced = PacedFeed(maker.layout, what, cycles, master)
    maker.now_ns = paced.now_ns
    paced.start()
    return Skin(paced)
