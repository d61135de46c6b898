"""A recording cycle by cycle, for `skinbus replay` and `skinbus export`, and what became of its frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.can.event import Event
from skinbus.cli.console import Console
from skinbus.cli.host import compiling
from skinbus.cli.output import echo
from skinbus.estimate import Quality
from skinbus.formatting import counted
from skinbus.master import CycleReport
from skinbus.model import Arm
from skinbus.skin.contact import Contact
from skinbus.skin.cycle import Cycle
from skinbus.skin.replayed import Replayed
from skinbus.view.event_log import nodes_by_bus

READING = np.dtype(
    [
        ("t_ns", "<i8"),
        ("cycle", "<i4"),
        *((name, "u1") for name in ("bus", "node_id", "link", "tactel")),
        ("counts", "<i4"),
        ("pressure_pa", "<f8"),
        *((name, "<f4") for name in ("zeroed_pa", "x", "y", "z")),
    ]
)
"""A reading; ``zeroed_pa`` is NaN where the master did not use it; x, y, z are m in the frame of the link."""
COVARIANCES = ("cov_s_s", "cov_s_a", "cov_s_force", "cov_a_a", "cov_a_force", "cov_force_force")
"""The upper triangle of a covariance, row by row."""
CONTACT_COLUMNS = (
    "t_ns", "cycle", "id", "identity", "link", "level", "state", "quality",
    "s_m", "a_m", "force_n", "x_m", "y_m", "z_m", "normal_x", "normal_y", "normal_z", *COVARIANCES,
)  # fmt: skip
"""Of tables of contacts."""


class RecordedCycle(NamedTuple):
    """One cycle of a recording; its own times count from the first frame."""

    cycle: Cycle
    t_ns: int
    """Of its SYNC, or of the change that began it, ns since 1970."""
    readings: npt.NDArray[Any]
    """(n_readings,) of READING."""


class Recorded(Replayed):
    """The cycles of a log, to be gone through once."""

    def __init__(
        self,
        log: str | Path,
        arm: Arm,
        channels: Sequence[str],
        console: Console,
        *,
        level: str,
        zero: bool,
        on_event: Callable[[Event], Any] = lambda event: None,
    ) -> None:
        """Begin, with settings of the replay.

        Raises:
            ConfigError: the log cannot be read, holds no frame, or its times are none.
            AddressError: which interface is which bus cannot be decided.
        """
        with compiling(console):
            super().__init__(log, arm, channels, level=level, zero=zero, on_event=on_event)
        arm = self.arm
        patch = arm.tactel_patch
        rows = self._tactels = np.zeros(arm.n_tactels, READING)
        rows["bus"], rows["node_id"], rows["link"] = arm.patch_bus[patch], arm.node_id[patch], arm.tactel_link
        rows["tactel"] = np.arange(arm.n_tactels) - arm.patch_start[patch] + 1
        for k, link in enumerate(arm.links):
            here = np.flatnonzero(arm.tactel_link == k)
            points, _ = link.surface.position(arm.tactel_s[here], arm.tactel_a[here])
            rows["x"][here], rows["y"][here], rows["z"][here] = points.T

    def has_readings(self) -> bool:
        """Return whether a patch of the arm sent readings, and say so if none did."""
        if self.replay.master.table.last_fresh.any():
            return True
        others = ", ".join(sorted(self.elsewhere))
        also = f" It also holds {others}: see --channel." if others else ""
        why = "no SYNC is in it." if self.sync.bus is None else "is it the log of another arm?"
        echo(f"no patch of {self.arm.name} answered a SYNC with readings: {why}{also}", err=True)
        return False

    def summary(self) -> Iterator[str]:
        """Return what became of frames and lines, and who was silent; what did not occur is left out."""
        used, taken, reader = self.replay.master.gather.counters, self.replay.taken, self.reader
        yield (
            f"readings: {counted(used.accepted, 'frame')} used, {used.late} late, {used.missing} missing, "
            f"{used.bad_length} of wrong length; {counted(taken.n_others, 'other frame')}"
        )
        kinds = [(taken.n_error, "error frame", ""), (taken.n_remote, "remote frame", "")]
        kinds += [(n, "frame", f" of {name}") for name, n in sorted(self.elsewhere.items())]
        if first := reader.first_strange:
            kinds.append((reader.n_strange, "line", f" without a frame, the first at {first.key}"))
        left_out = [counted(n, thing) + where for n, thing, where in kinds if n]
        if left_out := left_out + ["the last line, which is not whole"] * reader.is_cut:
            yield f"left out: {'; '.join(left_out)}"
        if reader.n_dropped:
            yield f"the recorder had no room for {counted(reader.n_dropped, 'frame')}"
        if n_jumps := self.replay.timeline.n_jumps:
            yield f"the clock of the log jumped {counted(n_jumps, 'time')}"
        silent = nodes_by_bus(self.arm, self.replay.master.table.last_fresh == 0)
        yield from (f"no readings of {where}" for where in silent)

    def made(self, cycle: Cycle, report: CycleReport) -> RecordedCycle:
        """Return a cycle with the readings of the boards that sent them."""
        stamp_ns = report.t_ns + self.replay.stamp_ns
        (tactels,) = np.nonzero(report.fresh[self.arm.tactel_patch])
        rows = self._tactels[tactels]
        used = cycle.readings
        rows["t_ns"] = stamp_ns
        rows["cycle"] = cycle.number
        master = self.replay.master
        rows["counts"] = master.gather.counts[tactels]
        rows["pressure_pa"] = (rows["counts"] - self.arm.tactel_offset[tactels]) * master.cycle.scale[tactels]
        rows["zeroed_pa"] = np.where(used.valid, used.pressures, np.nan)[tactels]
        return RecordedCycle(cycle, stamp_ns, rows)


def values_of(contact: Contact) -> dict[str, Any]:
    """Return a contact as numbers and words: m, N, in the frame of its link; None for what is not known."""
    covariance = np.full((3, 3), np.nan) if contact.covariance is None else contact.covariance
    place = contact.s, contact.a, contact.force
    numbers = np.concatenate([place, contact.point, contact.normal, covariance[np.triu_indices(3)]]).tolist()
    return {
        **{name: getattr(contact, name) for name in ("id", "identity", "link", "level")},
        "state": contact.state.name.lower(),
        "quality": None
        if contact.quality is None
        else str(Quality(contact.quality).name).lower().replace("_", "-"),
        **{
            name: None if math.isnan(number) else number
            for name, number in zip(CONTACT_COLUMNS[8:], numbers, strict=True)
        },
    }
