"""A recording through the master again: contacts and pressures less the zeros, by cycle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.cli.export.rows import LOGGED
from skinbus.master import CycleReport
from skinbus.master.replay import Replay
from skinbus.model import Arm
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.recording import Recording


@dataclass(frozen=True, slots=True)
class Recomputed:
    """What a master makes of a recording."""

    level: str
    contacts: npt.NDArray[Any]
    """(n_contacts,) of LOGGED; ``t_ns`` is the time of the SYNC in the log, ``group`` counts the cycles."""
    groups: npt.NDArray[Any]
    """(n_cycles,) of LOGGED without contacts."""
    pressures: npt.NDArray[np.float32]
    """(n_cycles, n_tactels) Pa, less the zeros; NaN where the master did not use a reading."""

    def pressures_of(
        self, readings: npt.NDArray[Any], begun: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.float32]:
        """Return the pressure of each reading (of ROW); NaN where it was not used, or its cycle is not known.

        begun: (n, 2) number and time of the cycles of the readings
        """
        if not len(self.groups):
            return np.full(len(readings), np.nan, np.float32)
        row_at = np.full(int(begun[:, 0].max(initial=0)) + 1, -1, np.int64)
        order = np.argsort(self.groups["t_ns"], kind="stable")
        stamps = self.groups["t_ns"][order]
        at = np.searchsorted(stamps, begun[:, 1])
        found = (at < len(stamps)) & (stamps[np.minimum(at, len(stamps) - 1)] == begun[:, 1])
        row_at[begun[found, 0]] = order[at[found]]
        rows = row_at[readings["cycle"]]
        values = self.pressures[rows, readings["tactel"]]
        return np.where((rows >= 0) & ~readings["twice"], values, np.float32(np.nan))


def recompute(
    log: Path,
    arm: Arm,
    channels: tuple[str, ...],
    *,
    level: str,
    zero: bool,
    on_time: Callable[[float], None],
) -> Recomputed:
    """Return what a master makes of a log; ``on_time`` is called with the seconds gone through."""
    recording = Recording(log, arm, channels)
    maker = CycleMaker(recording.arm)
    contacts: list[npt.NDArray[Any]] = []
    groups: list[npt.NDArray[Any]] = []
    pressures: list[npt.NDArray[np.float32]] = []

    def on_cycle(report: CycleReport) -> None:
        cycle = maker.make(replay.master, report)
        rows = np.zeros(len(cycle.records), LOGGED)
        group = np.zeros(1, LOGGED)
        rows["contact"] = cycle.records
        for out in (rows, group):
            out["t_ns"], out["cycle"] = replay.sync_stamp_ns, cycle.number
            out["group"], out["sync"] = cycle.number, report.counter
        contacts.append(rows)
        groups.append(group)
        readings = cycle.readings
        pressures.append(np.where(readings.valid, readings.pressures, np.nan).astype(np.float32))
        on_time(1e-9 * report.t_ns)

    replay = Replay(
        recording.arm,
        sync_bus=recording.sync.bus,
        on_cycle=on_cycle,
        level=level,
        zero_at_start=zero,
    )
    for frame in recording:
        replay.take(frame)
    replay.end()
    return Recomputed(
        level,
        np.concatenate([np.zeros(0, LOGGED), *contacts]),
        np.concatenate([np.zeros(0, LOGGED), *groups]),
        np.array(pressures, np.float32).reshape(-1, arm.n_tactels),
    )
