"""Readings in TPDOs: a whole batch of frames to the counts of all tactels at once.

The mapping of every patch is compiled to flat columns: a table from identifier to PDO, and for each PDO
the tactels, bit offsets and lengths of its readings. A frame that is not a plain data frame, that has
an identifier unknown on its bus or the wrong length is counted and changes nothing.

A PDO may also map the stamp of its readings: the SYNC counter of their sample, its status and its age
(``profile.SAMPLE_COUNTER``, ``SAMPLE_STATUS``, ``SAMPLE_AGE``), each in bytes of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.arrays import Bytes, Ints, Ints32
from skinbus.can.core import NEVER
from skinbus.can.frame import ERROR, EXTENDED, MAX_DATA, RTR, FrameBatch
from skinbus.model import Arm, PlacedPatch
from skinbus.objects.cia import (
    ANALOGUE_DELTA,
    ANALOGUE_INTERRUPT_ENABLE,
    ANALOGUE_TRIGGER,
    TransmissionType,
    Trigger,
)
from skinbus.objects.pdo import PdoMap, carries_readings, readings_in, tpdos
from skinbus.objects.profile import SAMPLE_AGE, SAMPLE_COUNTER, SAMPLE_STATUS, has, index_of, number_at

N_IDS = 2048
MAX_TPDOS = 31
"""Of one patch: they are bits of an int32."""

NO_PLAIN = EXTENDED | RTR | ERROR
"""Flags that a frame with readings does not have."""

DEADLINE = 0.9
"""Share of the period after which a cycle closes with what it has: leaves a tenth to compute and publish."""


TIMER_SLACK = 1.5
"""Times the event timer without a frame before a patch that runs freely is silent: frames queue."""


class Unpacked(NamedTuple):
    """How many frames of a batch were readings, strangers, or of a wrong length."""

    n_ok: int
    n_unknown: int
    n_bad_length: int


class Answers(NamedTuple):
    """The account by which frames answer a SYNC: a classic PDO does not carry which.

    A TPDO answers each SYNC once and in their order. So a frame answers the newest SYNC if that is the only
    one without answer; with more of them it is an older reading; with none, another node or SYNC caused it.
    """

    due: Ints32
    """(n_frames,) SYNCs that each TPDO has not answered."""
    came: Ints32
    """(n_patches,) bit mask of the TPDOs that came, whatever they answer."""
    n_frames: Ints32
    """(n_patches,) frames that came."""
    n_excess: Ints32
    """(n_patches,) of them frames that answer no SYNC, and differ from the one that did."""
    last_ns: Ints
    """(n_patches,) time of the last frame."""
    free_ns: Ints
    """(n_frames,) time of the newest frame of each TPDO that runs freely, 0 for none; it answers no SYNC."""
    counter: Ints32
    """(1,) counter of the newest SYNC, 0 for none; a frame that carries another one does not answer it."""


class ReadingsPlan:
    """The compiled mapping of all patches of an arm.

    n_frames:      frames of one cycle in which every patch sends everything
    cob_ids_on:    identifiers that carry readings, by bus
    expected:      (n_patches,) bit mask of the TPDOs that make a reading complete
    on_sync:       (n_patches,) those of them that answer a SYNC; the others run freely
    free:          (n_frames,) bool, whether a PDO runs freely: it is sent on a change or by a timer
    has_free:      whether any does
    pause_ns:      (n_frames,) longest time between two frames of one that does
    on_change:     (n_patches,) bool, whether what a patch sent last holds until it sends something else
    counts_scale:  (n_tactels,) Pa per count, gain included
    counts_offset: (n_tactels,) counts at no pressure
    pdo_patch:     (n_frames,) patch of each PDO with readings
    pdo_bit:       (n_frames,) bit of each PDO in ``expected``
    stamped:       (n_frames, 4) bool, whether a PDO carries the SYNC counter, the status and the age (two
                   bytes) of its sample
    """

    def __init__(self, arm: Arm, ods: Sequence[ObjectDictionary]) -> None:
        """Compile the TPDOs in ``ods``, one dictionary per patch of ``arm``.

        Raises:
            ValueError: the dictionaries do not fit the arm, or two PDOs share an identifier.
        """
        if len(ods) != arm.n_patches:
            raise ValueError(f"{len(ods)} object dictionaries for {arm.n_patches} patches")
        self.n_patches, self.n_tactels = arm.n_patches, arm.n_tactels
        found = [(p, k, pdo) for p, od in enumerate(ods) for k, pdo in enumerate(_carriers(p, od))]
        self.n_frames = len(found)
        patches, numbers, pdos = zip(*found, strict=True) if found else ((), (), ())
        self.pdo_patch = np.array(patches, np.int32)
        self.pdo_bit = np.left_shift(1, np.array(numbers, np.int32))
        self.expected = np.zeros(self.n_patches, np.int32)
        np.bitwise_or.at(self.expected, self.pdo_patch, self.pdo_bit)
        self.free = np.array(
            [pdo.transmission_type >= TransmissionType.EVENT_MANUFACTURER for pdo in pdos], np.bool_
        )
        self.has_free = bool(self.free.any())
        self.on_sync = np.zeros_like(self.expected)
        np.bitwise_or.at(self.on_sync, self.pdo_patch[~self.free], self.pdo_bit[~self.free])
        timers = [round(TIMER_SLACK * 1e6 * pdo.event_timer_ms) or NEVER for pdo in pdos]
        self.pause_ns = np.array(timers, np.int64)
        self.on_change = np.array([number_at(od, ANALOGUE_INTERRUPT_ENABLE) != 0 for od in ods])
        self._delta = np.concatenate(
            [_deltas(od, arm.patches[p].patch.n_tactels) for p, od in enumerate(ods)]
        )
        bus = np.array([arm.patches[p].bus for p in patches], np.uint8)
        cob_id = np.array([pdo.cob_id for pdo in pdos], np.uint32)
        self._length = np.array([pdo.length for pdo in pdos], np.uint8)
        self._pdo_of = np.full((len(arm.buses), N_IDS), -1, np.int32)
        for number, address in enumerate(zip(bus.tolist(), cob_id.tolist(), strict=True)):
            if self._pdo_of[address] >= 0:
                raise ValueError(f"COB-ID 0x{address[1]:03X} is used twice")
            self._pdo_of[address] = number
        self.cob_ids_on = tuple(frozenset(cob_id[bus == k].tolist()) for k in range(len(arm.buses)))
        steps = np.array([p.patch.transducer.step for p in arm.patches])
        self.counts_scale = steps[arm.tactel_patch] * arm.tactel_gain
        self.counts_offset = arm.tactel_offset
        stamps = [_stamp(ods[p], pdo) for p, _, pdo in found]
        self._stamp = np.array(stamps, np.int32).reshape(-1, 4)
        self.stamped = self._stamp >= 0
        # Entries of each PDO, (n_frames, most entries): short PDOs repeat theirs, which changes nothing.
        entries = [_entries(p, pdo, arm.patches[p], int(arm.patch_start[p])) for p, _, pdo in found]
        most = max(map(len, entries), default=0)
        table = np.array([np.resize(e, (most, 4)) for e in entries], np.int64).reshape(-1, most, 4)
        self._tactel, offset, bits, self._above = np.moveaxis(table, 2, 0)
        self._first, self._shift, self._span = offset >> 3, offset & 7, np.left_shift(1, bits)

    def answers(self) -> Answers:
        """Return an account in which no SYNC is unanswered."""
        came, n_frames, n_excess = np.zeros((3, self.n_patches), np.int32)
        due, last_ns = np.zeros(self.n_frames, np.int32), np.zeros(self.n_patches, np.int64)
        free_ns = np.zeros(self.n_frames, np.int64)
        return Answers(due, came, n_frames, n_excess, last_ns, free_ns, np.zeros(1, np.int32))

    def unanswered(self, answers: Answers) -> Ints32:
        """Return the most SYNCs that a TPDO of each patch has not answered, (n_patches,)."""
        most = np.zeros(self.n_patches, np.int32)
        np.maximum.at(most, self.pdo_patch, answers.due * ~self.free)
        return most

    def new_stamps(self) -> Bytes:
        """Return room for the stamps of all PDOs, (n_frames, 4) uint8, as ``stamped``; zeros."""
        return np.zeros((self.n_frames, 4), np.uint8)

    def unpack(
        self,
        batch: FrameBatch,
        counts: Ints32,
        seen: Ints32,
        stamps: Bytes | None = None,
        answers: Answers | None = None,
    ) -> Unpacked:
        """Write the readings of a ``FrameBatch`` into counts and mark their TPDOs in ``seen``.

        With ``answers`` only frames that answer the newest SYNC are written and marked; see ``Answers``.

        Args:
            counts: (n_tactels,) int32; only tactels whose frame came are written.
            seen:   (n_patches,) int32; bits are added, never taken away.
            stamps: (n_frames, 4) uint8, as ``stamped``; of the PDOs that came and carry them.
            answers: the account of SYNCs and their answers, which is kept.
        """
        pdo, is_wrong = self._classify(batch)
        is_known = pdo >= 0
        (rows,) = np.nonzero(is_known & ~is_wrong)
        result = Unpacked(len(rows), len(pdo) - int(is_known.sum()), int(is_wrong.sum()))
        if not len(rows):
            return result
        pdo, data = pdo[rows], batch.frames["data"][rows]
        tactels, values = self._decode(pdo, data)
        if answers is None:
            counts[tactels] = values
        else:
            answer, excess = self._account(pdo, data, batch.t_ns[rows], answers)
            counts[tactels[answer]] = values[answer]
            differs = (counts[tactels[excess]] != values[excess]).any(axis=1)
            np.add.at(answers.n_excess, self.pdo_patch[pdo[excess]], differs)
            pdo, data = pdo[answer], data[answer]
        self._mark(pdo, data, seen, stamps)
        return result

    def unpack_free(
        self, batch: FrameBatch, counts: Ints32, stamps: Bytes, free_ns: Ints
    ) -> tuple[int, bool]:
        """Take the frames of TPDOs that run freely out of a batch; write their readings, and when they came.

        Returns:
            How many there were, and whether one was sent because its readings changed.
        """
        pdo, is_wrong = self._classify(batch)
        is_free = (pdo >= 0) & ~is_wrong & self.free[pdo]
        pdo, rows = pdo[is_free], np.flatnonzero(is_free)
        if not len(rows):
            return 0, False
        data, free_ns[pdo] = batch.frames["data"][rows], batch.t_ns[rows]
        tactels, values = self._decode(pdo, data)
        change = np.abs(values - counts[tactels]) > self._delta[tactels]
        counts[tactels] = values
        self._mark(pdo, data, np.zeros_like(self.expected), stamps)
        kept = np.flatnonzero(~is_free)
        batch.frames[: len(kept)], batch.t_ns[: len(kept)] = batch.frames[kept], batch.t_ns[kept]
        batch.n = len(kept)
        return len(rows), bool((change.any(axis=1) & self.on_change[self.pdo_patch[pdo]]).any())

    def _classify(self, batch: FrameBatch) -> tuple[Ints32, Any]:
        """Return the PDO of each frame, -1 for none, and which are of a wrong length."""
        frames = batch.frames[: batch.n]
        bus, can_id = frames["bus"], frames["can_id"]
        n_buses, n_ids = self._pdo_of.shape
        pdo = self._pdo_of[np.minimum(bus, n_buses - 1), np.minimum(can_id, n_ids - 1)]
        pdo[(bus >= n_buses) | (can_id >= n_ids) | (frames["flags"] & NO_PLAIN != 0)] = -1
        return pdo, (pdo >= 0) & (frames["length"] != self._length[pdo])

    def _mark(self, pdo: Ints32, data: Bytes, seen: Ints32, stamps: Bytes | None) -> None:
        """Mark the TPDOs of frames, and write their stamps; of two frames of a PDO the later one counts."""
        np.bitwise_or.at(seen, self.pdo_patch[pdo], self.pdo_bit[pdo])
        if stamps is not None and self.stamped.any():
            frame, column = np.nonzero(self.stamped[pdo])
            stamps[pdo[frame], column] = data[frame, self._stamp[pdo[frame], column]]

    def _decode(self, pdo: Ints32, data: Bytes) -> tuple[Any, Any]:
        """Return tactel and value of each entry, (n, most entries), of frames with data (n, 64)."""
        padded = np.zeros((len(data), MAX_DATA + 8), np.uint8)
        padded[:, :MAX_DATA] = data
        numbers: Ints = np.ndarray(  # the 8 bytes from each byte on
            (len(data), MAX_DATA), "<i8", padded, strides=(MAX_DATA + 8, 1)
        )
        span = self._span[pdo]
        words = numbers[np.arange(len(data))[:, None], self._first[pdo]] >> self._shift[pdo] & span - 1
        words -= np.where(words >= self._above[pdo], span, 0)  # signed, with the top bit set
        return self._tactel[pdo], words

    def _account(self, pdo: Ints32, data: Bytes, t_ns: Ints, answers: Answers) -> tuple[list[int], list[int]]:
        """Return which frames answer the newest SYNC and which answer none; keep the account."""
        patch = self.pdo_patch[pdo]
        np.bitwise_or.at(answers.came, patch, self.pdo_bit[pdo])
        np.add.at(answers.n_frames, patch, 1)
        answers.last_ns[patch] = t_ns
        counter, carried = int(answers.counter[0]), [0] * len(pdo)
        if counter:
            at = self._stamp[pdo, 0]
            carried = np.where(at >= 0, data[np.arange(len(pdo)), at], 0).tolist()
        due, answer, excess = answers.due.tolist(), [], []
        for k, (d, sampled_for) in enumerate(zip(pdo.tolist(), carried, strict=True)):
            if sampled_for and sampled_for != counter:
                continue
            left = min(due[d], 1) if sampled_for else due[d]
            if left == 1:
                answer.append(k)
            elif left <= 0:
                excess.append(k)
            due[d] = left - (left > 0)
        answers.due[:] = due
        return answer, excess


def _carriers(patch: int, od: ObjectDictionary) -> list[PdoMap]:
    """Return the TPDOs of a patch that carry readings."""
    carriers = [pdo for pdo in tpdos(od) if carries_readings(pdo)]
    if len(carriers) > MAX_TPDOS:
        raise ValueError(f"patch {patch} has {len(carriers)} TPDOs with readings; at most {MAX_TPDOS}")
    return carriers


def _deltas(od: ObjectDictionary, n: int) -> Ints32:
    """Return by how much each reading of a patch must change to be sent, (n_tactels,) counts (CiA 401)."""
    subs = range(1, n + 1)
    by_delta = [number_at(od, ANALOGUE_TRIGGER, k) & Trigger.DELTA for k in subs]
    deltas = [number_at(od, ANALOGUE_DELTA, k) if used else 0 for k, used in zip(subs, by_delta, strict=True)]
    return np.array(deltas, np.int32)


def _entries(
    patch: int, pdo: PdoMap, placed: PlacedPatch, first_tactel: int
) -> list[tuple[int, int, int, int]]:
    """Return tactel, bit offset, bits and the first value that is too large of each reading of a PDO."""
    entries = []
    for entry in readings_in(pdo):
        where = f"patch {patch}, TPDO {pdo.number}"
        if entry.sub > placed.patch.n_tactels:
            raise ValueError(f"{where}: reading {entry.sub} of {placed.patch.n_tactels} tactels")
        if not 1 <= entry.bits <= 32 - (not entry.signed):
            raise ValueError(f"{where}: a reading of {entry.bits} bits does not fit an int32")
        above = 1 << (entry.bits - entry.signed)
        entries.append((first_tactel + entry.sub - 1, entry.offset, entry.bits, above))
    return entries


def _stamp(od: ObjectDictionary, pdo: PdoMap) -> tuple[int, int, int, int]:
    """Return the bytes of a PDO that hold the counter, status and age of its sample, -1 without."""
    at = {(e.index, e.sub, e.bits): e.offset // 8 for e in pdo.entries if e.offset % 8 == 0}

    def of(name: str, bits: int) -> int:
        return at.get((*index_of(od, name), bits), -1) if has(od, name) else -1

    age = of(SAMPLE_AGE, 16)
    return of(SAMPLE_COUNTER, 8), of(SAMPLE_STATUS, 8), age, age + (age >= 0)
