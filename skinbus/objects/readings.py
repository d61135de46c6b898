"""Readings in TPDOs: a whole batch of frames to the counts of all tactels at once, and back.

The mapping of every patch is compiled to flat columns: a table from identifier to PDO, and for each PDO
the tactels, bit offsets and lengths of its readings. A frame that is not a plain data frame, that has
an identifier unknown on its bus or the wrong length is counted and changes nothing.

A PDO may also map the stamp of its readings: the SYNC counter of their sample and its status
(``profile.SAMPLE_COUNTER``, ``profile.SAMPLE_STATUS``), each in a byte of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import LONG, FrameBatch
from skinbus.jit import kernel
from skinbus.model import Arm, PlacedPatch
from skinbus.objects.pdo import PdoMap, carries_readings, readings_in, tpdos
from skinbus.objects.profile import SAMPLE_COUNTER, SAMPLE_STATUS, index_of

Counts = npt.NDArray[np.int32]
Stamps = npt.NDArray[np.uint8]

N_IDS: Final = 2048
MAX_TPDOS: Final = 31
"""Of one patch: they are bits of an int32."""

DEADLINE: Final = 0.9
"""Share of the period after which a cycle closes with what it has: leaves a tenth to compute and publish."""


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

    due: Counts
    """(n_frames,) SYNCs that each TPDO has not answered."""
    came: Counts
    """(n_patches,) bit mask of the TPDOs that came, whatever they answer."""
    n_frames: Counts
    """(n_patches,) frames that came."""
    n_excess: Counts
    """(n_patches,) of them frames that answer no SYNC, and differ from the one that did."""
    last_ns: npt.NDArray[np.int64]
    """(n_patches,) time of the last frame."""
    counter: Counts
    """(1,) counter of the newest SYNC, 0 for none; a frame that carries another one does not answer it."""


class ReadingsPlan:
    """The compiled mapping of all patches of an arm.

    cob_ids:       identifiers that carry readings, on whatever bus
    cob_ids_on:    the same by bus
    expected:      (n_patches,) bit mask of the TPDOs that make a reading complete
    counts_scale:  (n_tactels,) Pa per count, before gain
    counts_offset: (n_tactels,) counts at no pressure
    pdo_patch:     (n_frames,) patch of each PDO with readings
    pdo_bit:       (n_frames,) bit of each PDO in ``expected``
    stamped:       (n_frames, 2) bool, whether a PDO carries the SYNC counter and the status of its sample
    """

    def __init__(self, arm: Arm, ods: Sequence[ObjectDictionary]) -> None:
        """Compile the TPDOs in ``ods``, one dictionary per patch of ``arm``.

        Raises:
            ValueError: the dictionaries do not fit the arm, or two PDOs share an identifier.
        """
        if len(ods) != arm.n_patches:
            raise ValueError(f"{len(ods)} object dictionaries for {arm.n_patches} patches")
        columns = _Columns()
        for p, od in enumerate(ods):
            columns.add_patch(p, od, int(arm.patch_start[p]), arm.patches[p])
        self.n_patches, self.n_tactels = arm.n_patches, arm.n_tactels
        self.cob_ids = frozenset(columns.cob_id)
        self.cob_ids_on = tuple(
            frozenset(c for b, c in zip(columns.bus, columns.cob_id, strict=True) if b == bus)
            for bus in range(len(arm.buses))
        )
        self.expected = _column(columns.expected, np.int32)
        self.counts_scale = _column(
            np.repeat([p.patch.transducer.step for p in arm.patches], np.diff(arm.patch_start)), np.float64
        )
        self.counts_offset = arm.tactel_offset
        self._lut = np.full((len(arm.buses), N_IDS), -1, np.int32)
        self._lut[columns.bus, columns.cob_id] = np.arange(len(columns.cob_id))
        self._bus = _column(columns.bus, np.uint8)
        self._cob_id = _column(columns.cob_id, np.uint32)
        self.pdo_patch = self._patch = _column(columns.patch, np.int32)
        self.pdo_bit = self._bit = _column(columns.bit, np.int32)
        self._stamp = _column(columns.stamp, np.int32)
        self.stamped = self._stamp >= 0
        self._length = _column(columns.length, np.uint8)
        self._flags = _column(np.where(self._length > CLASSIC_BYTES, LONG, 0), np.uint8)
        self._start = _column(columns.start, np.int32)
        self._tactel = _column(columns.tactel, np.int32)
        self._offset = _column(columns.offset, np.int32)
        self._bits = _column(columns.bits, np.int32)
        self._above = _column(columns.above, np.int64)
        nothing = np.zeros(0, np.int32)
        self._no_answers = Answers(nothing, nothing, nothing, nothing, np.zeros(0, np.int64), nothing)

    def answers(self) -> Answers:
        """Return an account in which no SYNC is unanswered."""
        came, n_frames, n_excess = np.zeros((3, self.n_patches), np.int32)
        due, last_ns = np.zeros(self.n_frames, np.int32), np.zeros(self.n_patches, np.int64)
        return Answers(due, came, n_frames, n_excess, last_ns, np.zeros(1, np.int32))

    def unanswered(self, answers: Answers) -> Counts:
        """Return the most SYNCs that a TPDO of each patch has not answered, (n_patches,)."""
        most = np.zeros(self.n_patches, np.int32)
        np.maximum.at(most, self._patch, answers.due)
        return most

    @property
    def n_frames(self) -> int:
        """Frames of one cycle in which every patch sends everything."""
        return len(self._cob_id)

    def new_stamps(self) -> Stamps:
        """Return room for the stamps of all PDOs, (n_frames, 2) uint8: SYNC counter and status; zeros."""
        return np.zeros((self.n_frames, 2), np.uint8)

    def unpack(
        self,
        batch: FrameBatch,
        counts: Counts,
        seen: Counts,
        wrong: Counts | None = None,
        stamps: Stamps | None = None,
        answers: Answers | None = None,
    ) -> Unpacked:
        """Write the readings of a ``FrameBatch`` into counts and mark their TPDOs in ``seen``.

        With ``answers`` only frames that answer the newest SYNC are written and marked; see ``Answers``.

        Args:
            counts: (n_tactels,) int32; only tactels whose frame came are written.
            seen:   (n_patches,) int32; bits are added, never taken away.
            wrong:  (n_patches,) int32; a patch's frames of wrong length are added.
            stamps: (n_frames, 2) uint8; SYNC counter and status of the PDOs that came and carry them.
            answers: the account of SYNCs and their answers, which is kept.
        """
        self._check(counts, seen)
        if wrong is None:
            wrong = np.zeros(self.n_patches, np.int32)
        if stamps is None:
            stamps = self.new_stamps()
        frames = batch.frames[: batch.n]
        return Unpacked(
            *_unpack(
                frames["bus"],
                frames["can_id"],
                frames["length"],
                frames["flags"],
                frames["data"],
                batch.t_ns,
                self._lut,
                self._patch,
                self._bit,
                self._length,
                self._start,
                self._tactel,
                self._offset,
                self._bits,
                self._above,
                self._stamp,
                counts,
                seen,
                wrong,
                stamps,
                *(answers or self._no_answers),
            )
        )

    def pack(self, counts: Counts, batch: FrameBatch, t_ns: int = 0, stamps: Stamps | None = None) -> int:
        """Append to a ``FrameBatch`` the frames that carry counts, patch after patch; return how many.

        Counts beyond the width of their entry are clipped. ``stamps`` are as in :meth:`unpack`, else zeros.

        Raises:
            ValueError: the batch has no room for :attr:`n_frames` more.
        """
        self._check(counts, None)
        first, last = batch.n, batch.n + self.n_frames
        if last > len(batch.frames):
            raise ValueError(f"batch has room for {len(batch.frames) - first} frames; wanted {self.n_frames}")
        frames = batch.frames[first:last]
        frames["can_id"], frames["length"], frames["flags"] = self._cob_id, self._length, self._flags
        frames["bus"], frames["data"] = self._bus, 0
        _pack(counts, self._start, self._tactel, self._offset, self._bits, self._above, frames["data"])
        if stamps is not None:
            for column in range(2):
                (pdos,) = np.nonzero(self.stamped[:, column])
                frames["data"][pdos, self._stamp[pdos, column]] = stamps[pdos, column]
        batch.t_ns[first:last] = t_ns
        batch.n = last
        return self.n_frames

    def _check(self, counts: Counts, seen: Counts | None) -> None:
        if counts.dtype != np.int32 or counts.shape != (self.n_tactels,):
            raise ValueError(f"counts are {counts.dtype} {counts.shape}; wanted int32 ({self.n_tactels},)")
        if seen is not None and (seen.dtype != np.int32 or seen.shape != (self.n_patches,)):
            raise ValueError(f"seen is {seen.dtype} {seen.shape}; wanted int32 ({self.n_patches},)")


class _Columns:
    """Columns under construction: one row per PDO, and one per mapped reading."""

    def __init__(self) -> None:
        self.bus: list[int] = []
        self.cob_id: list[int] = []
        self.patch: list[int] = []
        self.bit: list[int] = []
        self.length: list[int] = []
        self.start: list[int] = [0]
        self.tactel: list[int] = []
        self.offset: list[int] = []
        self.bits: list[int] = []
        self.above: list[int] = []
        self.stamp: list[tuple[int, int]] = []
        self.expected: list[int] = []
        self._taken: set[tuple[int, int]] = set()

    def add_patch(self, patch: int, od: ObjectDictionary, first_tactel: int, placed: PlacedPatch) -> None:
        carriers = [pdo for pdo in tpdos(od) if carries_readings(pdo)]
        if len(carriers) > MAX_TPDOS:
            raise ValueError(f"patch {patch} has {len(carriers)} TPDOs with readings; at most {MAX_TPDOS}")
        self.expected.append((1 << len(carriers)) - 1)
        for k, pdo in enumerate(carriers):
            address = placed.bus, pdo.cob_id
            if address in self._taken:
                raise ValueError(f"COB-ID 0x{pdo.cob_id:03X} is used twice")
            self._taken.add(address)
            self.bus.append(placed.bus)
            self.cob_id.append(pdo.cob_id)
            self.patch.append(patch)
            self.bit.append(1 << k)
            self.length.append(pdo.length)
            self.stamp.append(_stamp(od, pdo))
            for entry in readings_in(pdo):
                where = f"patch {patch}, TPDO {pdo.number}"
                if entry.sub > placed.patch.n_tactels:
                    raise ValueError(f"{where}: reading {entry.sub} of {placed.patch.n_tactels} tactels")
                if not 1 <= entry.bits <= 32 - (not entry.signed):
                    raise ValueError(f"{where}: a reading of {entry.bits} bits does not fit an int32")
                self.tactel.append(first_tactel + entry.sub - 1)
                self.offset.append(entry.offset)
                self.bits.append(entry.bits)
                self.above.append(1 << (entry.bits - entry.signed))
            self.start.append(len(self.tactel))


def _stamp(od: ObjectDictionary, pdo: PdoMap) -> tuple[int, int]:
    """Return the bytes of a PDO that hold the SYNC counter and the status of its sample, -1 without."""
    if SAMPLE_COUNTER.object not in od.names:
        return -1, -1
    at = {(e.index, e.sub): e.offset // 8 for e in pdo.entries if e.bits == 8 and e.offset % 8 == 0}
    return at.get(index_of(od, SAMPLE_COUNTER), -1), at.get(index_of(od, SAMPLE_STATUS), -1)


def _column(values: Any, dtype: Any) -> npt.NDArray[Any]:
    array = np.array(values, dtype)
    array.setflags(write=False)
    return array


@kernel
def _unpack(
    bus: Any,
    can_id: Any,
    length: Any,
    flags: Any,
    data: Any,
    t_ns: Any,
    lut: Any,
    patch: Any,
    bit: Any,
    wanted: Any,
    start: Any,
    tactel: Any,
    offset: Any,
    bits: Any,
    above: Any,
    stamp: Any,
    counts: Any,
    seen: Any,
    wrong: Any,
    stamps: Any,
    due: Any,
    came: Any,
    n_frames: Any,
    n_excess: Any,
    last_ns: Any,
    counter: Any,
) -> Any:
    """Decode frames into counts; entries have 1..32 bits at any offset, values below ``above``."""
    n_ok = n_unknown = n_bad_length = 0
    counts_answers = len(due) > 0
    for f in range(len(can_id)):
        known = bus[f] < lut.shape[0] and can_id[f] < lut.shape[1] and flags[f] & 0x7 == 0
        pdo = lut[bus[f], can_id[f]] if known else -1
        if pdo < 0:
            n_unknown += 1
            continue
        p = patch[pdo]
        if length[f] != wanted[pdo]:
            n_bad_length += 1
            wrong[p] += 1
            continue
        n_ok += 1
        is_answer, is_excess = True, False
        if counts_answers:
            came[p] |= bit[pdo]
            n_frames[p] += 1
            last_ns[p] = t_ns[f]
            sampled_for = data[f, stamp[pdo, 0]] if stamp[pdo, 0] >= 0 and counter[0] > 0 else 0
            if sampled_for > 0:
                if sampled_for != counter[0]:
                    continue
                due[pdo] = min(due[pdo], 1)
            is_answer, is_excess = due[pdo] == 1, due[pdo] <= 0
            due[pdo] -= not is_excess
            if not is_answer and not is_excess:
                continue
        differs = False
        for e in range(start[pdo], start[pdo + 1]):
            first, last = offset[e] >> 3, (offset[e] + bits[e] - 1) >> 3
            word = np.int64(0)
            for b in range(first, last + 1):
                word |= np.int64(data[f, b]) << (8 * (b - first))
            word = (word >> (offset[e] & 7)) & ((np.int64(1) << bits[e]) - 1)
            if word >= above[e]:  # a signed entry whose top bit is set
                word -= np.int64(1) << bits[e]
            if is_answer:
                counts[tactel[e]] = word
            else:
                differs |= counts[tactel[e]] != word
        if is_answer:
            for k in range(2):
                if stamp[pdo, k] >= 0:
                    stamps[pdo, k] = data[f, stamp[pdo, k]]
            seen[p] |= bit[pdo]
        elif differs:
            n_excess[p] += 1
    return n_ok, n_unknown, n_bad_length


@kernel
def _pack(
    counts: Any,
    start: Any,
    tactel: Any,
    offset: Any,
    bits: Any,
    above: Any,
    data: Any,
) -> None:
    """Encode counts into zeroed data: the inverse of :func:`_unpack`."""
    for pdo in range(len(start) - 1):
        for e in range(start[pdo], start[pdo + 1]):
            low = above[e] - (np.int64(1) << bits[e])
            value = min(max(np.int64(counts[tactel[e]]), low), above[e] - 1)
            word = (value & ((np.int64(1) << bits[e]) - 1)) << (offset[e] & 7)
            first, last = offset[e] >> 3, (offset[e] + bits[e] - 1) >> 3
            for b in range(first, last + 1):
                data[pdo, b] |= np.uint8((word >> (8 * (b - first))) & 0xFF)
