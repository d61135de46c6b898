"""Columns of a recording: readings frame by frame, contacts as published, and the SYNC that each follows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.candump_batches import CandumpBatches
from skinbus.can.frame import EXTENDED, NO_DATA, FrameBatch
from skinbus.estimate import TrackState
from skinbus.jit import kernel
from skinbus.master.replay import Sync
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.objects.contacts import PAYLOAD, ContactState, unpack_contacts
from skinbus.objects.pdo import PdoEntry, carries_readings, readings_in, tpdos
from skinbus.objects.published import usual
from skinbus.objects.readings import DEADLINE, N_IDS
from skinbus.skin.cycle import CONTACT, UNKNOWN_LEVEL, fill_places
from skinbus.skin.recording import Recording

Ints = npt.NDArray[np.int64]

ROW: Final = np.dtype(
    [("t_ns", "<i8"), ("cycle", "<i4"), ("tactel", "<i4"), ("counts", "<i4"), ("twice", "?")]
)
"""A reading of a tactel (number within the arm) in a frame; ``twice``: its TPDO came again in this cycle."""

LOGGED: Final = np.dtype(
    [("t_ns", "<i8"), ("cycle", "<i4"), ("group", "<i4"), ("sync", "u1"), ("contact", CONTACT)]
)
"""A contact: its time, the cycle and the number of the master's report, its SYNC counter, and itself."""

NOWHERE: Final = 255
"""Bus of frames of interfaces that are no bus of the arm."""


_STATES: Final = {int(state): state.name.lower() for state in TrackState}


def state_name(state: int) -> str:
    """Return the state of a contact as a word; one that no master of ours publishes is a number."""
    return _STATES.get(state, str(state))


@dataclass(frozen=True, slots=True)
class LogPart:
    """Some frames of a recording, decoded."""

    readings: npt.NDArray[Any]
    """(n_readings,) of ROW, in the order of the frames."""
    contacts: npt.NDArray[Any]
    """(n_contacts,) of LOGGED: those that a master published."""
    groups: npt.NDArray[Any]
    """(n,) of LOGGED without contacts: the reports of cycles that the master published, also empty ones."""
    begun: Ints
    """(n, 2) number and time (ns) of the cycles that began."""


class _Frames(NamedTuple):
    """Frames as columns, (n,) each."""

    frames: npt.NDArray[Any]
    """Of FRAME_DTYPE."""
    t_ns: npt.NDArray[Any]
    bus: npt.NDArray[Any]
    pdo: npt.NDArray[Any]
    """That carries readings of the arm, else -1."""
    cycle: npt.NDArray[Any]
    begins: npt.NDArray[Any]
    """Whether a cycle begins with it."""


class ReadingDecoder:
    """The TPDOs with readings of all patches, compiled: frames to the counts of single tactels."""

    def __init__(self, arm: Arm, ods: Sequence[ObjectDictionary]) -> None:
        self._pdo_of = np.full((len(arm.buses), N_IDS), -1, np.int32)
        shapes: dict[tuple[int, tuple[PdoEntry, ...]], int] = {}
        shape: list[int] = []
        first: list[int] = []
        for p, (od, placed) in enumerate(zip(ods, arm.patches, strict=True)):
            for pdo in filter(carries_readings, tpdos(od)):
                self._pdo_of[placed.bus, pdo.cob_id] = len(shape)
                shape.append(shapes.setdefault((pdo.length, tuple(readings_in(pdo))), len(shapes)))
                first.append(int(arm.patch_start[p]))
        self._shapes = list(shapes)
        self._shape = np.array(shape, np.int32)
        self._length = np.array([length for length, _ in self._shapes], np.int32)[self._shape]
        self._first = np.array(first, np.int32)
        self.n_pdos = len(shape)

    def pdos(self, bus: npt.NDArray[np.int64], frames: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
        """Return the TPDO of each frame, -1 for one that carries no readings of the arm."""
        known = (bus != NOWHERE) & (frames["can_id"] < N_IDS) & (frames["flags"] & (NO_DATA | EXTENDED) == 0)
        found = self._pdo_of[np.where(known, bus, 0), np.where(known, frames["can_id"], 0)]
        return np.where(known, found, -1).astype(np.int32)

    def is_whole(self, pdo: npt.NDArray[np.int32], frames: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
        """Return which frames have the length of their TPDO."""
        return np.asarray((pdo >= 0) & (frames["length"] == self._length[pdo]))

    def decode(
        self, pdo: npt.NDArray[np.int32], data: npt.NDArray[np.uint8]
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int32], npt.NDArray[np.int64]]:
        """Return frame, tactel and counts of each reading, in the order of the frames; all are whole."""
        parts = []
        for k, (_, entries) in enumerate(self._shapes):
            (here,) = np.nonzero(self._shape[pdo] == k)
            if not len(here):
                continue
            counts = np.stack([_bits_of(data[here], entry) for entry in entries], -1)
            tactel = self._first[pdo[here], None] + np.array([entry.sub - 1 for entry in entries])
            parts.append((np.repeat(here, len(entries)), tactel.reshape(-1), counts.reshape(-1)))
        if not parts:
            return np.zeros(0, np.intp), np.zeros(0, np.int32), np.zeros(0, np.int64)
        frame, tactel, counts = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(frame, kind="stable")
        return frame[order], tactel[order].astype(np.int32), counts[order]


def _bits_of(data: npt.NDArray[np.uint8], entry: PdoEntry) -> Ints:
    """Return the value of one entry in frames, (n,)."""
    first, last = entry.offset // 8, (entry.offset + entry.bits - 1) // 8
    word = np.zeros(len(data), np.int64)
    for byte in range(first, last + 1):
        word |= data[:, byte].astype(np.int64) << (8 * (byte - first))
    word = (word >> (entry.offset % 8)) & ((1 << entry.bits) - 1)
    return word - ((word >> (entry.bits - 1)) << entry.bits) if entry.signed else word


class RecordingRows:
    """A recording with an arm, part by part; to be gone through once."""

    def __init__(self, log: Path, arm: Arm, channels: Sequence[str], node_id: int) -> None:
        """Read the head; ``node_id`` is that of the master whose contacts are taken.

        Raises:
            ConfigError: the log cannot be read, holds no frame, or its times are none.
            AddressError: which interface is which bus cannot be decided.
        """
        recording = Recording(log, arm, channels)
        self.arm = recording.arm
        self.sync: Sync = recording.sync
        self.reader = CandumpBatches(log)
        self.elsewhere: Counter[str] = Counter()
        """Frames of other interfaces, by name."""
        self.n_wrong = 0
        """Frames with readings that have not the length of their TPDO."""
        self.n_readings = self.n_contacts = self.n_cycles = 0
        self._buses = recording.buses
        self._decoder = ReadingDecoder(self.arm, recording.ods)
        published = usual(node_id)
        self._summary_id = published.summary.cob_id
        self._is_contact = np.zeros(N_IDS, np.bool_)
        self._is_contact[list(published.contact_ids)] = True
        self._came = np.full(self._decoder.n_pdos, -1, np.int64)  # cycle in which each TPDO came last
        self._begun_ns = np.iinfo(np.int64).min
        self._n_groups = 0
        self._counter = 0

    def __iter__(self) -> Iterator[LogPart]:
        """Go through it; no cycle is in two parts."""
        held = None
        for batch in self.reader.batches():
            some = self._sorted(batch)
            if held is not None:
                some = _Frames(*(np.concatenate(pair) for pair in zip(held, some, strict=True)))
            begins = np.flatnonzero(some.begins)
            end = int(begins[-1]) if len(begins) else len(some.t_ns)
            yield self._part(_Frames(*(column[:end] for column in some)))
            held = _Frames(*(column[end:].copy() for column in some))
        if held is not None and len(held.t_ns):
            yield self._part(held)

    def _sorted(self, batch: FrameBatch) -> _Frames:
        """Return the frames of a batch with bus, TPDO and cycle."""
        frames, t_ns = batch.frames[: batch.n], batch.t_ns[: batch.n]
        names = self.reader.channels
        bus_of = np.array([self._buses.get(name, NOWHERE) for name in names], np.int64)
        bus = bus_of[frames["bus"]]
        for k in np.flatnonzero(bus_of == NOWHERE).tolist():
            self.elsewhere[names[k]] += int((frames["bus"] == k).sum())
        pdo = self._decoder.pdos(bus, frames)
        cycle, begins = self._cycles(bus, frames, t_ns, pdo)
        return _Frames(frames, t_ns, bus, pdo, cycle, begins)

    def _part(self, some: _Frames) -> LogPart:
        frames, t_ns, cycle = some.frames, some.t_ns, some.cycle
        whole = self._decoder.is_whole(some.pdo, frames)
        self.n_wrong += int(((some.pdo >= 0) & ~whole).sum())
        rows = np.flatnonzero(whole)
        frame, tactel, counts = self._decoder.decode(some.pdo[rows], frames["data"][rows])
        readings = np.zeros(len(frame), ROW)
        readings["t_ns"], readings["cycle"] = t_ns[rows][frame], cycle[rows][frame]
        readings["tactel"], readings["counts"] = tactel, counts
        readings["twice"] = self._repeated(some.pdo[rows], cycle[rows])[frame]
        contacts, groups = self._published(some)
        self.n_readings += len(readings)
        self.n_contacts += len(contacts)
        return LogPart(readings, contacts, groups, np.stack([cycle[some.begins], t_ns[some.begins]], -1))

    def _cycles(self, bus: Ints, frames: Any, t_ns: Ints, pdo: Any) -> tuple[Ints, npt.NDArray[np.bool_]]:
        """Return the cycle of each frame, counted from 1 by SYNCs, and which frames begin one."""
        if self.sync.bus is not None:
            is_sync = (bus == self.sync.bus) & (frames["can_id"] == cia.SYNC_ID) & (frames["flags"] == 0)
            begins = is_sync
            cycle = self.n_cycles + np.cumsum(begins)
        else:
            cycle = np.zeros(len(frames), np.int64)
            longest_ns = int(DEADLINE * 1e9 / self.arm.bus.rate_hz)
            self._begun_ns = _cycles_without_sync(
                pdo, t_ns, self._came, self.n_cycles, self._begun_ns, longest_ns, cycle
            )
            begins = np.diff(cycle, prepend=self.n_cycles) > 0
        self.n_cycles = int(cycle[-1]) if len(cycle) else self.n_cycles
        return cycle, begins

    def _repeated(self, pdo: npt.NDArray[np.int32], cycle: Ints) -> npt.NDArray[np.bool_]:
        """Return which frames have a TPDO that came more than once in its cycle."""
        key = cycle * self._decoder.n_pdos + pdo
        _, inverse, n = np.unique(key, return_inverse=True, return_counts=True)
        return np.asarray(n[inverse] > 1)

    def _published(self, some: _Frames) -> tuple[Any, Any]:
        """Return the contacts that the master published, on the first of its buses, and its reports."""
        frames = some.frames
        plain = (some.bus == (self.sync.bus or 0)) & (frames["length"] == PAYLOAD.itemsize)
        plain &= (frames["flags"] == 0) & (frames["can_id"] < N_IDS)
        is_summary = plain & (frames["can_id"] == self._summary_id)
        nth = np.cumsum(is_summary)
        counters = np.concatenate([[self._counter], frames["data"][is_summary, 0]])
        (rows,) = np.nonzero(plain & self._is_contact[np.where(plain, frames["can_id"], 0)])
        payloads = frames["data"][rows, : PAYLOAD.itemsize]
        published = unpack_contacts(payloads)
        is_there = published.state != ContactState.NONE
        rows, published = rows[is_there], unpack_contacts(payloads[is_there])
        contacts = np.zeros(len(rows), LOGGED)
        record = contacts["contact"]
        for name in ("id", "link", "state", "s", "a", "force"):
            record[name] = getattr(published, name)
        record["level"] = UNKNOWN_LEVEL
        fill_places(record, self.arm)
        (reports,) = np.nonzero(is_summary)
        groups = np.zeros(len(reports), LOGGED)
        for out, at in ((contacts, rows), (groups, reports)):
            out["t_ns"], out["cycle"] = some.t_ns[at], some.cycle[at]
            out["group"], out["sync"] = self._n_groups + nth[at], counters[nth[at]]
        self._n_groups += len(reports)
        self._counter = int(counters[-1])
        return contacts, groups


@kernel
def _cycles_without_sync(
    pdo: Any, t_ns: Any, came: Any, number: Any, begun_ns: Any, longest_ns: Any, cycle: Any
) -> Any:
    """Write the cycle of each frame where there is no SYNC: it begins when a TPDO comes again, or in time."""
    for i in range(len(pdo)):
        p = pdo[i]
        if p >= 0:
            if number == 0 or came[p] == number or t_ns[i] >= begun_ns + longest_ns:
                number += 1
                begun_ns = t_ns[i]
            came[p] = number
        cycle[i] = number
    return begun_ns
