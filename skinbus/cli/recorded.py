"""A recording cycle by cycle, for `skinbus replay` and `skinbus export`, and what became of its frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from itertools import combinations_with_replacement
from typing import Any, Final, NamedTuple, TextIO

import numpy as np
import numpy.typing as npt

from skinbus.can.event import Event
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted, words_of
from skinbus.cli.output import echo
from skinbus.master import CycleReport
from skinbus.master.replay import Replay
from skinbus.model import Arm
from skinbus.skin.contact import Contact
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.replayed import Recording

READING: Final = np.dtype(
    [
        ("t_ns", "<i8"),
        ("cycle", "<i4"),
        *((name, "u1") for name in ("bus", "node_id", "link", "tactel")),
        ("counts", "<i4"),
        ("pressure_pa", "<f8"),
        ("zeroed_pa", "<f4"),
    ]
)
"""A reading; ``zeroed_pa`` is NaN where the master did not use it."""
SHOWN_EVERY: Final = 100
"""Cycles, after which the progress is shown."""
COVARIANCES: Final = dict(
    zip(
        ("cov_s_s", "cov_s_a", "cov_s_force", "cov_a_a", "cov_a_force", "cov_force_force"),
        combinations_with_replacement(range(3), 2),
        strict=True,
    )
)


class RecordedCycle(NamedTuple):
    """One cycle of a recording."""

    number: int
    """Counts from 1."""
    counter: int
    """Of its SYNC."""
    t_ns: int
    """Of its SYNC, ns since 1970."""
    t_s: float
    """The same, since the first frame."""
    tactels: npt.NDArray[np.intp]
    """(n_readings,) numbers within the arm of the tactels that were read."""
    readings: npt.NDArray[Any]
    """(n_readings,) of READING."""
    contacts: tuple[Contact, ...]


class Recorded:
    """The cycles of a log, to be gone through once."""

    def __init__(
        self,
        log: str | TextIO,
        arm: Arm,
        channels: Sequence[str],
        *,
        level: str,
        zero: bool,
        on_event: Callable[[Event], Any] | None = None,
    ) -> None:
        """Begin, with settings of the replay.

        Raises:
            ConfigError: the log cannot be read, holds no frame, or its times are none.
            AddressError: which interface is which bus cannot be decided.
        """
        self.recording = Recording(log, arm, channels)
        self.arm = arm = self.recording.arm
        self.replay = Replay(
            arm, sync_bus=self.recording.sync.bus, on_cycle=self._on_cycle, on_event=on_event, level=level,
            zero_at_start=zero,
        )  # fmt: skip
        self.n_cycles = self.n_readings = self.n_contacts = 0
        self._maker = CycleMaker(arm)
        self._new: deque[RecordedCycle] = deque()
        patch = arm.tactel_patch
        self._tactels = np.zeros(arm.n_tactels, READING)
        self._tactels["bus"], self._tactels["node_id"] = arm.patch_bus[patch], arm.node_id[patch]
        self._tactels["link"] = arm.tactel_link
        self._tactels["tactel"] = np.arange(arm.n_tactels) - arm.patch_start[patch] + 1
        steps = np.array([placed.patch.transducer.step for placed in arm.patches])
        self._scale = steps[patch] * arm.tactel_gain

    @property
    def now_s(self) -> float:
        """Time since the first frame, s."""
        return 1e-9 * self.replay.timeline.now_ns

    def cycles(self, console: Console) -> Iterator[RecordedCycle]:
        """Go through them, and show on a terminal how far it is."""
        with console.status("") if console.is_terminal else nullcontext() as status:
            for frame in self.recording:
                self.replay.take(frame)
                while self._new:
                    yield self._new.popleft()
                    if status and self.n_cycles % SHOWN_EVERY == 0:
                        status.update(f"{self.recording.reader.name} ... {self.now_s:.0f} s")
            self.replay.end()
        yield from self._new

    def has_readings(self) -> bool:
        """Return whether a patch of the arm sent readings, and say so if none did."""
        if self.replay.master.table.last_fresh.any():
            return True
        others = ", ".join(sorted(self.recording.elsewhere))
        also = f" It also holds {others}: see --channel." if others else ""
        echo(f"no patch of {self.arm.name} sent readings: is it the log of another arm?{also}", err=True)
        return False

    def summary(self) -> Iterator[str]:
        """Return what became of frames and lines; what did not occur is left out."""
        used, taken, reader = self.replay.master.gather.counters, self.replay.taken, self.recording.reader
        yield (
            f"readings: {counted(used.accepted, 'frame')} used, {used.late} late, {used.missing} missing, "
            f"{used.bad_length} of wrong length; {counted(taken.n_others, 'other frame')}"
        )
        left_out = [
            *(
                counted(n, f"{kind} frame")
                for kind, n in (("error", taken.n_error), ("remote", taken.n_remote))
                if n
            ),
            *(f"{counted(n, 'frame')} of {name}" for name, n in sorted(self.recording.elsewhere.items())),
        ]
        if reader.first_strange:
            n = counted(reader.n_strange, "line")
            left_out.append(f"{n} without a frame, the first at {reader.first_strange.key}")
        if reader.is_cut:
            left_out.append("the last line, which is not whole")
        if left_out:
            yield f"left out: {'; '.join(left_out)}"
        if reader.n_dropped:
            yield f"the recorder had no room for {counted(reader.n_dropped, 'frame')}"
        if n_jumps := self.replay.timeline.n_jumps:
            yield f"the clock of the log jumped {counted(n_jumps, 'time')}"

    def _on_cycle(self, report: CycleReport) -> None:
        cycle = self._maker.make(self.replay.master, report)
        (tactels,) = np.nonzero(report.fresh[self.arm.tactel_patch])
        rows, used, t_ns = self._tactels[tactels], cycle.readings, self.replay.sync_stamp_ns
        rows["t_ns"], rows["cycle"] = t_ns, cycle.number
        rows["counts"] = self.replay.master.gather.counts[tactels]
        rows["pressure_pa"] = (rows["counts"] - self.arm.tactel_offset[tactels]) * self._scale[tactels]
        rows["zeroed_pa"] = np.where(used.valid, used.pressures, np.nan)[tactels]
        self.n_cycles += 1
        self.n_readings += len(rows)
        self.n_contacts += len(cycle.contacts)
        self._new.append(
            RecordedCycle(cycle.number, cycle.counter, t_ns, 1e-9 * cycle.t_ns, tactels, rows, cycle.contacts)
        )


def values_of(contact: Contact) -> dict[str, Any]:
    """Return a contact as numbers and words: m, N, in the frame of its link; None for what is not known."""
    covariance = contact.covariance
    return {
        **{name: getattr(contact, name) for name in ("id", "identity", "link", "level")},
        "state": contact.state.name.lower(),
        "quality": None if contact.quality is None else words_of(contact.quality),
        "s_m": contact.s,
        "a_m": contact.a,
        "force_n": contact.force,
        **dict(zip(("x_m", "y_m", "z_m"), contact.point.tolist(), strict=True)),
        **dict(zip(("normal_x", "normal_y", "normal_z"), contact.normal.tolist(), strict=True)),
        **{name: None if covariance is None else float(covariance[k]) for name, k in COVARIANCES.items()},
    }
