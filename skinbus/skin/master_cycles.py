"""Cycles of a master of this process: what it reports, as programs see it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from skinbus.can.clock import Clock
from skinbus.estimate import LEVELS, TrackState
from skinbus.master import CycleReport, Master
from skinbus.model import Arm
from skinbus.skin.cycle import (
    CONTACT,
    PATCH,
    UNKNOWN_LEVEL,
    Cycle,
    Now,
    Readings,
    Records,
    SkinLayout,
    fill_places,
)

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts


class MasterCycle(Cycle):
    """A cycle of a master; its places in space are computed when they are asked for."""

    def __init__(
        self,
        number: int,
        report: CycleReport,
        arm: Arm,
        layout: SkinLayout,
        clock: Clock | None,
        records: _LaterRecords,
        patches: Records,
        faults: npt.NDArray[np.uint8],
    ) -> None:
        now = Now(clock, report.t_ns + report.latency_ns)
        super().__init__(
            number,
            report.t_ns,
            report.counter,
            report.level,
            report.flags,
            1e-9 * report.latency_ns,
            layout,
            now,
            budget_us=math.inf if report.budget_us is None else report.budget_us,
        )
        self._report = report
        self._arm = arm
        self._records = records
        self._patches = patches
        self._faults = faults

    @property
    def records(self) -> Records:
        """The contacts as records."""
        return self._records()

    @property
    def robot(self) -> RobotContacts | None:
        """All that is known of the robot."""
        return self._report.robot

    def _rows(self) -> tuple[bytes, int]:
        return self._records.without_places().tobytes() if len(self._report.tracks) else b"", 0

    def _later_records(self) -> Callable[[], Records]:
        return self._records

    def _robot_rows(self) -> npt.NDArray[np.int64]:
        """Return the rows of the contacts: their columns are those of the contacts that are seen."""
        return self._report.tracks.row

    @property
    def patch_records(self) -> Records:
        """The patches as records."""
        return self._patches

    @cached_property
    def readings(self) -> Readings:
        """The readings."""
        arm, report = self._arm, self._report
        valid = report.fresh[arm.tactel_patch] & arm.tactel_healthy & (self._faults == 0)
        return Readings(np.where(valid, report.pressures, 0.0), valid, self._faults)


class _LaterRecords:
    """The contacts of a report as records, made when they are first asked for: by the thread of a program."""

    def __init__(self, report: CycleReport, before: _LaterRecords | None, arm: Arm) -> None:
        self._report = report
        self._arm = arm
        self._is_placed = False
        self._lock = threading.RLock()
        self._records: Records | None = None
        if (
            report.tracks.row < 0
        ).any():  # now: later it would need the cycle before, and that the one before
            self._records = _records(report, before.without_places() if before else np.zeros(0, CONTACT))

    def __call__(self) -> Records:
        """Return the records, whole."""
        with self._lock:
            records = self.without_places()
            if not self._is_placed:
                fill_places(records, self._arm)
                self._is_placed = True
            return records

    def without_places(self) -> Records:
        """Return the records; where they are in space may be missing."""
        with self._lock:
            if self._records is None:
                self._records = _records(self._report, np.zeros(0, CONTACT))
            return self._records


def _records(report: CycleReport, before: Records) -> Records:
    """Return contacts without their places in space; those not seen are as they were last seen."""
    tracks, contacts = report.tracks, report.contacts
    records = np.zeros(len(tracks), CONTACT)
    for name in ("identity", "seen_ns", "id", "link", "state", "s", "a"):
        records[name] = getattr(tracks, name)
    records["force"] = np.where(tracks.state == TrackState.LIFT, 0.0, tracks.force)
    records["level"] = UNKNOWN_LEVEL
    seen = np.flatnonzero(tracks.row >= 0)
    rows = tracks.row[seen]
    records["quality"][seen] = contacts.quality[rows]
    records["level"][seen] = [LEVELS.index(level) for level in contacts.level[rows]]
    records["covariance"][seen] = contacts.covariance[rows]
    records["has_covariance"][seen] = contacts.covariance[rows, 2, 2] > 0.0
    for n in np.flatnonzero(tracks.row < 0).tolist():
        for last in before[before["identity"] == tracks.identity[n]]:
            for name in ("quality", "level", "covariance", "has_covariance"):
                records[name][n] = last[name]
    return records


class CycleMaker:
    """Makes cycles of the reports of a master; to be called by its ``on_cycle``, or before its next step."""

    def __init__(self, arm: Arm, clock: Clock | None = None) -> None:
        """``clock`` is that of the reports, for ages; without one they are as of the end of the cycle."""
        self.layout = SkinLayout.of(arm)
        self._arm = arm
        self._clock = clock
        self._number = 0
        self._before: _LaterRecords | None = None

    def make(self, master: Master, report: CycleReport) -> Cycle:
        """Return the next cycle."""
        self._number += 1
        table = master.table
        patches = np.zeros(len(table.state), PATCH)
        patches["state"], patches["emcy"] = table.state, table.error
        patches["last_fresh_ns"] = table.last_fresh
        faults = master.cycle.plausibility.faults.astype(np.uint8)
        records = self._before = _LaterRecords(report, self._before, self._arm)
        return MasterCycle(
            self._number, report, self._arm, self.layout, self._clock, records, patches, faults
        )
