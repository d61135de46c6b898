"""Cycles of a master of this process: what it reports, as programs see it."""

from __future__ import annotations

import math
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
    Layout,
    Now,
    Readings,
    Records,
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
        layout: Layout,
        clock: Clock | None,
        records: Records,
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

    @cached_property
    def records(self) -> Records:
        """The contacts as records."""
        fill_places(self._records, self._arm)
        return self._records

    @property
    def robot(self) -> RobotContacts | None:
        """All that is known of the robot."""
        return self._report.robot

    def _robot_row(self, k: int) -> int:
        """Return the row of a contact: its columns are those of the contacts that are seen."""
        return int(self._report.tracks.row[k])

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


class CycleMaker:
    """Makes cycles of the reports of a master; to be called by its ``on_cycle``."""

    def __init__(self, arm: Arm, clock: Clock | None = None) -> None:
        """``clock`` is that of the reports, for ages; without one they are as of the end of the cycle."""
        self.layout = Layout.of(arm)
        self._arm = arm
        self._clock = clock
        self._number = 0
        self._before = np.zeros(0, CONTACT)
        self._none = np.zeros(0, CONTACT)

    def make(self, master: Master, report: CycleReport) -> Cycle:
        """Return the next cycle."""
        self._number += 1
        table = master.table
        patches = np.zeros(len(table.state), PATCH)
        patches["state"], patches["emcy"] = table.state, table.error
        patches["last_fresh_ns"] = table.last_fresh
        faults = master.cycle.plausibility.faults.astype(np.uint8)
        records = self._before = self._records(report) if len(report.tracks) else self._none
        return MasterCycle(
            self._number, report, self._arm, self.layout, self._clock, records, patches, faults
        )

    def _records(self, report: CycleReport) -> Records:
        """Return the contacts without their places in space; those not seen are as they were last seen."""
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
            for before in self._before[self._before["identity"] == tracks.identity[n]]:
                for name in ("quality", "level", "covariance", "has_covariance"):
                    records[name][n] = before[name]
        return records
