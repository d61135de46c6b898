"""A recording cycle by cycle, as records: readings, published contacts, and contacts that are made now."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import Frame
from skinbus.cli.formatting import words_of
from skinbus.estimate import LEVELS, TrackState
from skinbus.master import CycleReport
from skinbus.master.replay import Replay
from skinbus.model import Arm
from skinbus.objects.contacts import PAYLOAD, ContactState, unpack_contacts
from skinbus.objects.published import usual
from skinbus.skin.cycle import CONTACT, UNKNOWN_LEVEL, fill_places
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.replayed import Recording

Records = npt.NDArray[Any]

READING: Final = np.dtype(
    [
        ("t_ns", "<i8"),
        ("cycle", "<i4"),
        ("bus", "u1"),
        ("node_id", "u1"),
        ("link", "u1"),
        ("tactel", "u1"),
        ("counts", "<i4"),
        ("pressure_pa", "<f8"),
        ("zeroed_pa", "<f4"),
    ]
)
"""A reading; ``zeroed_pa`` is NaN where the master did not use it."""
STATES: Final = {int(state): state.name.lower() for state in TrackState}


@dataclass(slots=True)
class RecordedCycle:
    """One cycle of a recording."""

    number: int
    """Counts from 1."""
    t_ns: int
    """Of its SYNC, ns since 1970."""
    tactels: npt.NDArray[np.intp]
    """(n_readings,) numbers within the arm of the tactels that were read."""
    readings: Records
    """(n_readings,) of READING."""
    recomputed: Records
    """(n,) of CONTACT: what a master makes of the readings now."""
    published: Records = field(default_factory=lambda: np.zeros(0, CONTACT))
    """(n,) of CONTACT: what the master in the recording published."""

    @property
    def contacts(self) -> dict[str, Records]:
        """The contacts by their source."""
        return {"published": self.published, "recomputed": self.recomputed}


class Recorded:
    """The cycles of a log, to be gone through once."""

    def __init__(
        self, log: Path, arm: Arm, channels: Sequence[str], *, level: str, zero: bool, node_id: int
    ) -> None:
        """Begin; ``node_id`` is that of the master in the log, others are settings of the replay.

        Raises:
            ConfigError: the log cannot be read, holds no frame, or its times are none.
            AddressError: which interface is which bus cannot be decided.
        """
        self.recording = Recording(log, arm, channels)
        self.arm = arm = self.recording.arm
        sync_bus = self.recording.sync.bus
        self.replay = Replay(arm, sync_bus=sync_bus, on_cycle=self._on_cycle, level=level, zero_at_start=zero)
        self.n_cycles = self.n_readings = 0
        self.n_contacts = {"published": 0, "recomputed": 0}
        self._maker = CycleMaker(arm)
        self._open: deque[RecordedCycle] = deque()
        self._contact_ids, self._contact_bus = frozenset(usual(node_id).contact_ids), sync_bus or 0
        patch = arm.tactel_patch
        self._tactels = np.zeros(arm.n_tactels, READING)
        self._tactels["bus"], self._tactels["node_id"] = arm.patch_bus[patch], arm.node_id[patch]
        self._tactels["link"] = arm.tactel_link
        self._tactels["tactel"] = np.arange(arm.n_tactels) - arm.patch_start[patch] + 1
        steps = np.array([placed.patch.transducer.step for placed in arm.patches])
        self._scale = steps[patch] * arm.tactel_gain

    def __iter__(self) -> Iterator[RecordedCycle]:
        published: list[bytes] = []
        for frame in self.recording:
            self.replay.take(frame)
            while self._open and self._open[0].t_ns != self.replay.sync_stamp_ns:  # the next one has begun
                yield self._finished(published)
            if self._is_contact(frame):
                published.append(frame.data)
        self.replay.end()
        while self._open:
            yield self._finished(published)

    def _is_contact(self, frame: Frame) -> bool:
        is_plain = not frame.flags and len(frame.data) == PAYLOAD.itemsize
        return is_plain and frame.bus == self._contact_bus and frame.can_id in self._contact_ids

    def _on_cycle(self, report: CycleReport) -> None:
        cycle = self._maker.make(self.replay.master, report)
        (tactels,) = np.nonzero(report.fresh[self.arm.tactel_patch])
        self.n_cycles += 1
        rows = self._tactels[tactels]
        rows["t_ns"], rows["cycle"] = self.replay.sync_stamp_ns, self.n_cycles
        rows["counts"] = self.replay.master.gather.counts[tactels]
        rows["pressure_pa"] = (rows["counts"] - self.arm.tactel_offset[tactels]) * self._scale[tactels]
        used = cycle.readings
        rows["zeroed_pa"] = np.where(used.valid, used.pressures, np.nan)[tactels]
        self._open.append(
            RecordedCycle(self.n_cycles, self.replay.sync_stamp_ns, tactels, rows, cycle.records.copy())
        )

    def _finished(self, published: list[bytes]) -> RecordedCycle:
        """Return the oldest cycle with what was published in it."""
        cycle = self._open.popleft()
        columns = unpack_contacts(b"".join(published))
        published.clear()
        records = np.zeros(len(columns.id), CONTACT)
        for name, column in columns._asdict().items():
            records[name] = column
        records["level"] = UNKNOWN_LEVEL
        records = records[records["state"] != ContactState.NONE]
        fill_places(records, self.arm)
        cycle.published = records
        self.n_readings += len(cycle.readings)
        for source, contacts in cycle.contacts.items():
            self.n_contacts[source] += len(contacts)
        return cycle


def state_of(contact: Any) -> str:
    """Return the state of a contact as a word; one that no master of ours publishes is a number."""
    return STATES.get(int(contact["state"]), str(contact["state"]))


def level_of(contact: Any) -> str | None:
    """Return the level of the estimator that made a contact, None where it is not known."""
    return LEVELS[contact["level"]] if contact["level"] < len(LEVELS) else None


def quality_of(contact: Any) -> str | None:
    """Return the flags of a contact in words, None where they are not known."""
    return words_of(int(contact["quality"])) if contact["level"] < len(LEVELS) else None
