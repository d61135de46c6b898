"""Columns of a recording: readings frame by frame, contacts as published, and the SYNC that each follows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.can.candump_batches import CandumpBatches
from skinbus.can.frame import EXTENDED, NO_DATA, FrameBatch
from skinbus.cli.formatting import words_of
from skinbus.estimate import LEVELS, TrackState
from skinbus.master import CycleReport
from skinbus.master.replay import Replay
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.objects.contacts import PAYLOAD, ContactState, unpack_contacts
from skinbus.objects.pdo import PdoEntry, carries_readings, readings_in, tpdos
from skinbus.objects.published import usual
from skinbus.objects.readings import DEADLINE, N_IDS
from skinbus.skin.cycle import CONTACT, UNKNOWN_LEVEL, fill_places
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.recording import Recording

Columns = npt.NDArray[Any]

ROW: Final = np.dtype(
    [("t_ns", "<i8"), ("cycle", "<i4"), ("tactel", "<i4"), ("counts", "<i4"), ("twice", "?")]
)
"""A reading of a tactel (number within the arm) in a frame; ``twice``: its TPDO came again in this cycle."""
LOGGED: Final = np.dtype([("t_ns", "<i8"), ("cycle", "<i4"), ("contact", CONTACT)])
"""A contact with its time and the number of its cycle, which counts the SYNCs from 1."""


STATES: Final = {int(state): state.name.lower() for state in TrackState}


def state_name(state: int) -> str:
    """Return the state of a contact as a word; one that no master of ours publishes is a number."""
    return STATES.get(int(state), str(state))


def level_of(contact: Any) -> str | None:
    """Return the level of the estimator that made a contact (of CONTACT), None where it is not known."""
    return LEVELS[contact["level"]] if contact["level"] < len(LEVELS) else None


def quality_of(contact: Any) -> str | None:
    """Return the flags of a contact (of CONTACT) in words, None where they are not known."""
    return words_of(int(contact["quality"])) if contact["level"] < len(LEVELS) else None


class LogPart(NamedTuple):
    """Whole cycles of a recording, decoded."""

    readings: Columns
    """(n_readings,) of ROW, in the order of the frames."""
    contacts: Columns
    """(n_contacts,) of LOGGED: those that a master published."""
    begun: npt.NDArray[np.int64]
    """(n, 2) number and time (ns) of the cycles that began."""


class _Frames(NamedTuple):
    """Frames as columns, (n,) each."""

    frames: Columns
    t_ns: Columns
    bus: Columns
    pdo: Columns
    """That carries readings of the arm, else -1."""
    cycle: Columns
    begins: Columns


class RecordingRows:
    """A recording with an arm, part by part; to be gone through once."""

    def __init__(self, log: Path, arm: Arm, channels: Sequence[str], node_id: int) -> None:
        """Read the head; ``node_id`` is that of the master whose contacts are taken.

        Raises:
            ConfigError: the log cannot be read, holds no frame, or its times are none.
            AddressError: which interface is which bus cannot be decided.
        """
        recording = Recording(log, arm, channels)
        self.arm, self.reader = recording.arm, CandumpBatches(log)
        self.elsewhere: Counter[str] = Counter()
        """Frames of other interfaces, by name."""
        self.n_wrong = 0
        """Frames with readings that have not the length of their TPDO."""
        self.n_readings = self.n_contacts = self.n_cycles = 0
        self._sync_bus, self._buses = recording.sync.bus, recording.buses
        self._pdos = [
            (p, pdo) for p, od in enumerate(recording.ods) for pdo in filter(carries_readings, tpdos(od))
        ]
        bus_of = [int(self.arm.patch_bus[p]) for p, _ in self._pdos]
        # the last row is that of interfaces which are no bus of the arm
        self._pdo_of = np.full((len(arm.buses) + 1, N_IDS), -1, np.int32)
        self._pdo_of[bus_of, [pdo.cob_id for _, pdo in self._pdos]] = np.arange(len(self._pdos))
        self._came = [-1] * len(self._pdos)
        """Cycle in which each TPDO came last, where there is no SYNC."""
        self._begun_ns = 0
        self._is_contact = np.zeros(N_IDS, np.bool_)
        self._is_contact[list(usual(node_id).contact_ids)] = True

    def __iter__(self) -> Iterator[LogPart]:
        """Go through it; no cycle is in two parts."""
        held = None
        for batch in self.reader.batches():
            some = self._joined(batch)
            if held is not None:
                some = _Frames(*(np.concatenate(pair) for pair in zip(held, some, strict=True)))
            begins = np.flatnonzero(some.begins)
            end = int(begins[-1]) if len(begins) else len(some.t_ns)
            yield self._decoded(_Frames(*(column[:end] for column in some)))
            held = _Frames(*(column[end:].copy() for column in some))
        if held is not None and len(held.t_ns):
            yield self._decoded(held)

    def _joined(self, batch: FrameBatch) -> _Frames:
        """Return the frames of a batch with bus, TPDO and cycle."""
        frames, t_ns = batch.frames[: batch.n], batch.t_ns[: batch.n]
        names = self.reader.channels
        bus = np.array([self._buses.get(name, len(self.arm.buses)) for name in names])[frames["bus"]]
        for k, name in enumerate(names):
            if name not in self._buses and (n := int((frames["bus"] == k).sum())):
                self.elsewhere[name] += n
        plain = (frames["can_id"] < N_IDS) & (frames["flags"] & (NO_DATA | EXTENDED) == 0)
        pdo = np.where(plain, self._pdo_of[bus, np.where(plain, frames["can_id"], 0)], -1)
        if self._sync_bus is not None:
            is_sync = (bus == self._sync_bus) & (frames["can_id"] == cia.SYNC_ID) & (frames["flags"] == 0)
            cycle = self.n_cycles + np.cumsum(is_sync)
        else:
            cycle = self._cycles_without_sync(pdo.tolist(), t_ns.tolist())
        begins = np.diff(cycle, prepend=self.n_cycles) > 0
        self.n_cycles = int(cycle[-1]) if len(cycle) else self.n_cycles
        return _Frames(frames, t_ns, bus, pdo, cycle, begins)

    def _cycles_without_sync(self, pdo: list[int], t_ns: list[int]) -> npt.NDArray[np.int64]:
        """Return the cycle of each frame: one begins when a TPDO comes again, or in time."""
        longest_ns = int(DEADLINE * 1e9 / self.arm.bus.rate_hz)
        number, cycles = self.n_cycles, []
        for k, t in zip(pdo, t_ns, strict=True):
            if k >= 0:
                if number == 0 or self._came[k] == number or t >= self._begun_ns + longest_ns:
                    number, self._begun_ns = number + 1, t
                self._came[k] = number
            cycles.append(number)
        return np.array(cycles, np.int64)

    def _decoded(self, some: _Frames) -> LogPart:
        parts = [np.zeros(0, ROW)]
        order = [np.zeros(0, np.intp)]
        for k in np.unique(some.pdo[some.pdo >= 0]).tolist():
            p, pdo = self._pdos[k]
            (rows,) = np.nonzero((some.pdo == k) & (some.frames["length"] == pdo.length))
            self.n_wrong += int((some.pdo == k).sum()) - len(rows)
            _, inverse, n = np.unique(some.cycle[rows], return_inverse=True, return_counts=True)
            for entry in readings_in(pdo):
                part = np.zeros(len(rows), ROW)
                part["t_ns"], part["cycle"] = some.t_ns[rows], some.cycle[rows]
                part["tactel"] = self.arm.patch_start[p] + entry.sub - 1
                part["counts"] = _bits_of(some.frames["data"][rows], entry)
                part["twice"] = n[inverse] > 1
                parts.append(part)
                order.append(rows)
        readings = np.concatenate(parts)[np.argsort(np.concatenate(order), kind="stable")]
        contacts = self._published(some)
        self.n_readings += len(readings)
        self.n_contacts += len(contacts)
        return LogPart(readings, contacts, np.stack([some.cycle, some.t_ns], -1)[some.begins])

    def _published(self, some: _Frames) -> Columns:
        """Return the contacts that the master published, on the first of its buses."""
        frames = some.frames
        plain = (some.bus == (self._sync_bus or 0)) & (frames["length"] == PAYLOAD.itemsize)
        plain &= (frames["flags"] == 0) & (frames["can_id"] < N_IDS)
        (rows,) = np.nonzero(plain & self._is_contact[np.where(plain, frames["can_id"], 0)])
        published = unpack_contacts(frames["data"][rows, : PAYLOAD.itemsize])
        contacts: Columns = np.zeros(len(rows), LOGGED)
        contacts["t_ns"], contacts["cycle"] = some.t_ns[rows], some.cycle[rows]
        for name in ("id", "link", "state", "s", "a", "force"):
            contacts["contact"][name] = getattr(published, name)
        contacts["contact"]["level"] = UNKNOWN_LEVEL
        contacts = contacts[published.state != ContactState.NONE]
        fill_places(contacts["contact"], self.arm)
        return contacts


def _bits_of(data: npt.NDArray[np.uint8], entry: PdoEntry) -> npt.NDArray[np.int64]:
    """Return the value of one entry in frames, (n,)."""
    first, last = entry.offset // 8, (entry.offset + entry.bits - 1) // 8
    word: npt.NDArray[np.int64] = np.zeros(len(data), np.int64)
    for byte in range(first, last + 1):
        word |= data[:, byte].astype(np.int64) << (8 * (byte - first))
    word = (word >> (entry.offset % 8)) & ((1 << entry.bits) - 1)
    if entry.signed:
        word -= (word >> (entry.bits - 1)) << entry.bits
    return word


@dataclass(frozen=True, slots=True)
class Recomputed:
    """What a master makes of a recording; its cycles are named by the times of their SYNCs in the log."""

    contacts: Columns
    """(n_contacts,) of LOGGED, in order of time."""
    t_ns: npt.NDArray[np.int64]
    """(n_cycles,) in order."""
    pressures: npt.NDArray[np.float32]
    """(n_cycles, n_tactels) Pa, less the zeros; NaN where the master did not use a reading."""

    def of(self, part: LogPart) -> tuple[npt.NDArray[np.float32], Columns]:
        """Return the pressure of each reading of a part, NaN where it was not used, and its contacts."""
        numbers, begun_ns = part.begun.T
        row = np.minimum(np.searchsorted(self.t_ns, begun_ns), max(len(self.t_ns) - 1, 0))
        row_of = np.full(int(numbers.max(initial=0)) + 1, -1, np.int64)
        if len(self.t_ns):
            row_of[numbers] = np.where(self.t_ns[row] == begun_ns, row, -1)
        rows = row_of[np.minimum(part.readings["cycle"], len(row_of) - 1)]
        known = (rows >= 0) & ~part.readings["twice"]
        pressures = np.full(len(rows), np.nan, np.float32)
        pressures[known] = self.pressures[rows[known], part.readings["tactel"][known]]
        contacts = self.contacts[np.isin(self.contacts["t_ns"], begun_ns)]
        contacts["cycle"] = numbers[np.searchsorted(begun_ns, contacts["t_ns"])]
        return pressures, contacts


def recompute(
    log: Path,
    arm: Arm,
    channels: Sequence[str],
    *,
    level: str,
    zero: bool,
    on_time: Callable[[float], None],
) -> Recomputed:
    """Return what a master makes of a log.

    Args:
        log: the recording.
        arm: whose patches were recorded.
        channels: interfaces in the log, by bus or as NAME=CHANNEL.
        level: of the estimator.
        zero: whether the master takes what each patch reads first for its zero.
        on_time: called with the seconds gone through.
    """
    recording = Recording(log, arm, channels)
    maker = CycleMaker(recording.arm)
    contacts = [np.zeros(0, LOGGED)]
    pressures: list[npt.NDArray[np.float32]] = []
    times: list[int] = []

    def on_cycle(report: CycleReport) -> None:
        cycle = maker.make(replay.master, report)
        rows = np.zeros(len(cycle.records), LOGGED)
        rows["contact"], rows["t_ns"] = cycle.records, replay.sync_stamp_ns
        contacts.append(rows)
        times.append(replay.sync_stamp_ns)
        readings = cycle.readings
        pressures.append(np.where(readings.valid, readings.pressures, np.nan).astype(np.float32))
        on_time(1e-9 * report.t_ns)

    replay = Replay(
        recording.arm, sync_bus=recording.sync.bus, on_cycle=on_cycle, level=level, zero_at_start=zero
    )
    for frame in recording:
        replay.take(frame)
    replay.end()
    order = np.argsort(times, kind="stable")
    made = np.concatenate(contacts)
    return Recomputed(
        made[np.argsort(made["t_ns"], kind="stable")],
        np.array(times, np.int64)[order],
        np.array(pressures, np.float32).reshape(-1, arm.n_tactels)[order],
    )
