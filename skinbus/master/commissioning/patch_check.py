"""The check of one patch on a bus against the checklist of its firmware.

A rule is a dialogue in ``patch_check.txt``: what is sent, and what must come of it. Where that takes
arithmetic it is a script below, of the same name. A script returns a detail to show, and raises
``BrokenRuleError`` when the patch does not keep the rule.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import Step
from skinbus.can.frame import RTR, Frame, Frames
from skinbus.master.commissioning.sessions import Listen, Reply, Request, Script, ScriptCore, Timeouts
from skinbus.node.context import NS_PER_MS
from skinbus.node.nmt import nmt_frame
from skinbus.node.sync import MAX_COUNTER
from skinbus.objects import cia
from skinbus.objects.board import describe_patch
from skinbus.objects.cia import NmtCommand
from skinbus.objects.guard import NO_LIMIT, GuardLimits
from skinbus.objects.pdo import PdoMap, carries_readings, readings_in, tpdos
from skinbus.objects.profile import number_at

BOOT_NS = 2_000 * NS_PER_MS
"""A board that has not booted after this has none of the loaders that are in use, which take 1 s at most."""
TIMEOUTS = Timeouts(sdo_ns=500 * NS_PER_MS, store_ns=5_000 * NS_PER_MS)
HEARTBEAT_MS = 100
N_SYNCS = 2000
"""SYNCs that are answered, 40 s: what is lost once in 300 is seen."""
N_COMPARED = 4
CHANGES = 5
"""Values of a reading from which it is more than a constant."""
PRESS_NS = 30_000 * NS_PER_MS
PRESSED = 3.0
"""Touch thresholds of a press."""
SYNC_PERIOD_NS = 20 * NS_PER_MS
ANSWER_NS = 100 * NS_PER_MS
"""For what a node does at once: an EMCY, a change of state."""
EMCY_LENGTH = 8
STEP_NS = 30 * NS_PER_MS
"""For answers to a frame in a dialogue; shorter than the times in the table."""


class Grade(Enum):
    """What came of a rule."""

    PASS = "pass"
    FAIL = "FAIL"
    SKIPPED = "skipped"


Check = Script[Any]
"""A script: it returns a detail to show, None for nothing."""


class BrokenRuleError(Exception):
    """The patch does not keep a rule."""


class Rule(NamedTuple):
    """One line of the checklist."""

    name: str
    section: str
    """Where CiA 301, 305 or 401 says so; "skinbus" for what is our own."""
    text: str
    """What the firmware must do."""
    needs: frozenset[str] = frozenset()
    """Objects without which a board does not keep it: others are not asked; and the words of the table."""
    steps: Sequence[str] = ()
    """Of its dialogue."""

    @property
    def is_destructive(self) -> bool:
        """Whether the parameters stored in the patch are lost."""
        return "store" in self.needs


def load_rules() -> Iterator[Rule]:
    """Yield the rules of the table."""
    text = Path(__file__).with_suffix(".txt").read_text(encoding="utf-8")
    for block in text.split("\n# ")[1:]:
        head, *steps = block.strip().split("\n")
        name, section, what, needs = (part.strip() for part in head.split("|"))
        yield Rule(name, section, what, frozenset(needs.split()), steps)


RULES = tuple(load_rules())


class RuleResult(NamedTuple):
    """A rule, what came of it, and what was seen."""

    rule: Rule
    grade: Grade
    detail: str = ""


class PatchCheck(ScriptCore):
    """A core that goes through the rules one after another and then asks its host to stop.

    Args:
        node_id: of the patch.
        od: what its EDS says.
        response_ns: longest time from SYNC to the last of its TPDOs.
        rules: to be checked.
        n_syncs: SYNCs that are answered.
        ask: asks a person for a press; None: there is nobody.
        destructive: rules by which stored parameters are lost are checked too.
        on_sync: is called after each SYNC, and ``on_result`` after each rule.
    """

    def __init__(
        self,
        node_id: int,
        od: ObjectDictionary,
        response_ns: int,
        rules: Sequence[Rule],
        *,
        n_syncs: int = N_SYNCS,
        ask: Callable[[str], object] | None = None,
        destructive: bool = False,
        on_sync: Callable[[], object] = lambda: None,
        on_result: Callable[[RuleResult], object] = lambda result: None,
    ) -> None:
        super().__init__(self._run(rules, destructive=destructive), node_id, TIMEOUTS)
        self.node_id, self.od, self.response_ns = node_id, od, response_ns
        self.n_syncs, self.ask = n_syncs, ask
        self.results: list[RuleResult] = []
        self.on_sync, self._on_result = on_sync, on_result
        sync = range(1, cia.TransmissionType.SYNC_MAX + 1)
        self.pdos = [pdo for pdo in tpdos(od) if carries_readings(pdo) and pdo.transmission_type in sync]
        """TPDOs of readings that answer SYNCs."""
        self.now_ns = 0
        self.rounds: list[list[int]] = []
        """Readings that answered each SYNC, in the order of the TPDOs."""
        self.beats: list[list[int]] = []
        """Times of heartbeats meanwhile (ns), by half."""
        self.heard: list[Frame] = []
        """What came since the newest step of a dialogue."""
        self.error = 0
        """Error register in the newest EMCY."""
        self.value = b""
        """What was read last."""

    @property
    def passed(self) -> bool:
        """Whether no rule has failed."""
        return all(result.grade is not Grade.FAIL for result in self.results)

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        self.now_ns = now_ns
        return super().step(now_ns, frames)

    def _run(self, rules: Sequence[Rule], *, destructive: bool) -> Script[None]:
        for rule in rules:
            grade, detail = Grade.SKIPPED, "stored parameters would be lost"
            if "press" in rule.needs and not self.ask:
                detail = "with --press"
            elif destructive or not rule.is_destructive:
                try:
                    detail = (yield from self._script_of(rule)) or ""
                    grade = Grade.PASS
                except BrokenRuleError as broken:
                    grade, detail = Grade.FAIL, f"{rule.text} {broken}" if rule.steps else str(broken)
                if rule.steps or grade is Grade.FAIL:
                    yield from self.reset()  # what the rule has changed
            self.results.append(RuleResult(rule, grade, detail))
            self._on_result(self.results[-1])
        # the rules have changed parameters: a reset brings the stored ones back
        yield from self.reset()

    def _script_of(self, rule: Rule) -> Check:
        if not rule.steps:
            return SCRIPTS[rule.name](self)
        has_all = {int(word, 16) for word in rule.needs - {"store"}} <= {*self.od.indices}
        return self._hold(rule.steps if has_all else ())

    def sends(self, base: int, data: bytes | None = None) -> Callable[[Frame], bool]:
        """Return what identifies frames of a service of the patch (COB-ID less node-ID) with these data."""
        can_id = base + self.node_id
        return lambda frame: frame.can_id == can_id and not frame.flags and data in (None, frame.data)

    def command(
        self, command: NmtCommand, ns: int = ANSWER_NS, until: Callable[[Frame], bool] | None = None
    ) -> Script[None]:
        """Command the patch, and give it time."""
        yield Listen(ns, until, (nmt_frame(command, self.node_id),))

    def reset(self) -> Script[None]:
        """Reset the patch, and wait for its boot-up message."""
        yield from self.command(NmtCommand.RESET_NODE, BOOT_NS, self.sends(cia.HEARTBEAT_BASE, b"\0"))

    def _hold(self, steps: Sequence[str]) -> Check:
        """Go through the steps of a dialogue."""
        self.heard, self.error, self.value = list[Frame](), 0, b""
        yield from self._hear(nmt_frame(NmtCommand.PRE_OPERATIONAL, self.node_id))
        for number, step in enumerate(steps, 1):
            wrong = yield from self._take(*step.split())
            _need(not wrong, f"step {number}, {step}: {wrong}")

    def _hear(self, *send: Frame, ns: int = STEP_NS) -> Script[None]:
        self.heard = yield Listen(ns, send=send)
        for frame in filter(self.sends(cia.EMCY_BASE), self.heard):
            _need(len(frame.data) == EMCY_LENGTH, f"EMCY {frame.data.hex(' ')}; wanted {EMCY_LENGTH} bytes")
            self.error = frame.data[2]

    def _take(self, verb: str, *words: str) -> Script[str]:
        """Take a step; return what was wrong, nothing if it went well."""
        if verb in ("read", "write"):
            return (yield from self._transfer(verb, *words))
        if verb in ("off", "on"):
            index = int(words[0], 16)
            cob_id = number_at(self.od, index, cia.PDO_COB_ID)
            own = cob_id | cia.COB_ID_INVALID if verb == "off" else cob_id
            reply: Reply = yield Request(index, cia.PDO_COB_ID, own.to_bytes(4, "little"))
            return cia.describe_abort(reply.abort) if reply.abort else ""
        if verb in ("eds", "fits"):
            yield from _as_eds(self, words[0], zero_is_any=verb == "fits")
        elif verb in COMMANDS:
            ns = BOOT_NS if verb in ("reset", "comm") else STEP_NS
            yield from self._hear(nmt_frame(COMMANDS[verb], self.node_id), ns=ns)
        elif verb == "++":
            yield from self._hear(ns=int(words[0]) * NS_PER_MS)
        elif verb in ("->", ">>", "=>"):
            frame = self._frame(words)
            is_filled = verb == "->" and frame.can_id & ~0x7F in (cia.SDO_CLIENT_BASE, 0x780)
            data = frame.data.ljust(8, b"\0") if is_filled else frame.data
            yield from self._hear(frame._replace(data=data, flags=RTR if verb == "=>" else 0))
        elif verb == "^^":
            return self._first(self._frame(words))
        elif verb == "x":
            n = sum(map(self.sends(self._frame(words[2:]).can_id - self.node_id), self.heard))
            return "" if int(words[0]) <= n <= int(words[1]) else f"came {n} times"
        else:
            return self._compare(verb, self._frame(words))
        return ""

    def _frame(self, words: Sequence[str]) -> Frame:
        base, plus, _ = words[0].partition("+n")
        return Frame(int(base, 16) + self.node_id * bool(plus), self._bytes(" ".join(words[1:])))

    def _bytes(self, text: str) -> bytes:
        """Return the bytes that words of a step spell."""
        letters = {"n": bytes([self.node_id]), "v": self.value, "r": bytes([self.error])}
        if "l" in text:
            letters["l"] = _limits(self)
        for letter, data in letters.items():
            text = text.replace(letter, data.hex())
        spelled = bytearray.fromhex(text.strip("=&^ "))
        if "^" in text:
            spelled[-1] ^= 1
        return bytes(spelled)

    def _first(self, wanted: Frame) -> str:
        """Return what is wrong unless, but for other heartbeats, this came first of its frames, and once."""
        own = [frame for frame in self.heard if frame.can_id & 0x7F == self.node_id]
        came = [(f.can_id, f.data) for f in own if f.can_id != wanted.can_id or f.data == wanted.data]
        n = came.count((wanted.can_id, wanted.data))
        if n != 1:
            return f"came {n} times"
        can_id, data = came[0]
        return "" if can_id == wanted.can_id else f"0x{can_id:03X} {data.hex(' ')} came before it"

    def _compare(self, verb: str, wanted: Frame) -> str:
        """Return what is wrong with the frames that were heard with an identifier."""
        came = [frame.data for frame in self.heard if frame.can_id == wanted.can_id and not frame.flags & RTR]
        n = len(came)
        is_right = came and (came[-1] == wanted.data if verb == "==" else came[-1].startswith(wanted.data))
        if verb == "--":
            return f"came {n} times" if came else ""
        if verb != "~~" and n != 1:
            return f"came {n} times"
        return "" if is_right else f"came as {came[-1].hex(' ') if came else 'nothing'}"

    def _transfer(self, verb: str, place: str, *words: str) -> Script[str]:
        """Read or write; an exclamation mark asks for an abort, by one of the codes after it if there are."""
        values, mark, codes = " ".join(words).partition("!")
        data = self._bytes(values)
        index, _, sub = place.partition(":")
        reply: Reply = yield Request(int(index, 16), int(sub, 16), None if verb == "read" else data)
        self.value = reply.data
        if mark and not reply.abort:
            return "was accepted"
        wanted = [int(code, 16) for code in codes.split()]
        if reply.abort and (not mark or reply.is_silent or (wanted and reply.abort not in wanted)):
            return cia.describe_abort(reply.abort)
        is_so = mark or verb == "write" or reply.data.startswith(data)
        if "&" in values:
            is_so = any(a & b for a, b in zip(reply.data, data, strict=False))
        return "" if is_so else f"is {reply.data.hex(' ')}"


# parts of rules


def _need(is_so: object, otherwise: str) -> None:
    """Break the rule with a detail unless something is so."""
    if not is_so:
        raise BrokenRuleError(otherwise)


def _ask(request: Request) -> Script[bytes]:
    """Return the data of a transfer, which has to succeed."""
    reply: Reply = yield request
    what = "not answered" if reply.is_silent else f"aborted with 0x{reply.abort:08X}"
    _need(not reply.abort, f"0x{request.index:04X}:{request.sub:02X}: {what}")
    return reply.data


def _write(index: int, sub: int, value: int, size: int) -> Request:
    return Request(index, sub, value.to_bytes(size, "little"))


def _as_eds(patch: PatchCheck, pattern: str, *, zero_is_any: bool) -> Check:
    """Objects whose index and sub-index match a pattern hold what the EDS says."""
    for index, own in patch.od.indices.items():
        for sub in getattr(own, "subindices", (0,)):
            if re.fullmatch(pattern, place := f"{index:04X}:{sub:02X}"):
                seen = int.from_bytes((yield from _ask(Request(index, sub))), "little")
                wanted = number_at(patch.od, index, sub)
                is_so = seen == wanted or (zero_is_any and not wanted)
                _need(is_so, f"0x{place} is 0x{seen:X}; the EDS says 0x{wanted:X}")


def _counts(patch: PatchCheck) -> Script[list[int]]:
    """Return the readings of all tactels by SDO."""
    index = next(i for i in cia.READINGS if i in patch.od.indices)
    counts = []
    for sub in range(1, describe_patch(patch.od).n_tactels + 1):
        data = yield from _ask(Request(index, sub))
        counts.append(int.from_bytes(data, "little", signed=True))
    return counts


def _spare_bits(patch: PatchCheck) -> int:
    """Return how many bits of a reading lie below those of the converter."""
    transducer = describe_patch(patch.od).transducer
    return max(0, transducer.bits - (transducer.converter_bits or transducer.bits))


# the rules


def _readings(patch: PatchCheck) -> Check:
    """Every SYNC is answered once by every TPDO of readings, in order and in time.

    In the second half SYNCs carry a counter, if the board takes one.
    """
    pdos, slowest, n, is_beat = patch.pdos, 0, 0, patch.sends(cia.HEARTBEAT_BASE)
    wanted = [(pdo.cob_id, pdo.length) for pdo in pdos]
    ids = dict(wanted)
    yield _write(cia.HEARTBEAT_PRODUCER, 0, HEARTBEAT_MS, 2)
    for overflow in (0, MAX_COUNTER):
        yield from patch.command(NmtCommand.PRE_OPERATIONAL)
        reply: Reply = yield _write(cia.SYNC_COUNTER_OVERFLOW, 0, overflow, 1)
        is_counted = overflow and not reply.abort
        yield from patch.command(NmtCommand.START)
        patch.beats.append([])
        for k in range(patch.n_syncs // 2):
            sent_ns, n = patch.now_ns, n + 1
            counter = bytes([1 + k % MAX_COUNTER]) if is_counted else b""
            received = yield Listen(SYNC_PERIOD_NS, send=(Frame(cia.SYNC_ID, counter),))
            patch.beats[-1] += [f.t_ns for f in received if is_beat(f)]
            at = f"after SYNC {n} of {patch.n_syncs}{f' (counter {counter[0]})' if counter else ''}"
            came = [f for f in received if f.can_id in ids]
            sizes = [(f.can_id, len(f.data)) for f in came]
            wrong = f"{_listed(sizes)} {at}; wanted {_listed(wanted)}: all TPDOs once, from one queue"
            _need(sizes in (wanted, sorted(wanted)), wrong)
            slowest = max([slowest, *(f.t_ns - sent_ns for f in came)])
            patch.rounds.append(_values(pdos, came))
            patch.on_sync()
    yield from patch.command(NmtCommand.PRE_OPERATIONAL)
    yield _write(cia.SYNC_COUNTER_OVERFLOW, 0, 0, 1)
    detail = f"{n} SYNCs; SYNC to the last TPDO: {slowest / NS_PER_MS:.2f} ms at most"
    _need(slowest <= patch.response_ns, f"{detail}; wanted {patch.response_ns / NS_PER_MS:g} ms")
    return detail


def _listed(sizes: Sequence[tuple[int, int]]) -> str:
    return ", ".join(f"0x{can_id:03X} [{n}]" for can_id, n in sizes) or "no TPDO"


def _new_samples(patch: PatchCheck) -> Check:
    """A board without noise may repeat; with noise all its TPDOs change."""
    yield from ()
    if not patch.rounds:
        return
    is_new = np.diff(patch.rounds, axis=0) != 0
    starts = np.cumsum([0, *(len(readings_in(pdo)) for pdo in patch.pdos)])[:-1]
    n_same = int((~is_new.any(axis=1)).sum())
    n_new = int(np.logical_or.reduceat(is_new, starts, axis=1).all(axis=1).sum())
    again = f"{n_same} of {len(patch.rounds)} answers repeat the one before; sample anew at each SYNC"
    _need(min(n_same, n_new) <= 1 or n_same + n_new < len(is_new), again)


def _channels(patch: PatchCheck) -> Check:
    """No two readings that change are always the same."""
    yield from ()
    subs: dict[tuple[int, ...], int] = {}
    order = (entry.sub for pdo in patch.pdos for entry in readings_in(pdo))
    for sub, column in zip(order, zip(*patch.rounds, strict=True), strict=False):
        other = subs.setdefault(column, sub)
        same = f"readings {other} and {sub} are always equal; does the multiplexer switch and settle?"
        _need(other == sub or len(set(column)) < CHANGES, same)


def _beats_under_load(patch: PatchCheck) -> Check:
    yield from ()
    gaps = [b - a for beats in patch.beats for a, b in pairwise(beats)]
    n_lost = sum(max(0, round(gap / (HEARTBEAT_MS * NS_PER_MS)) - 1) for gap in gaps)
    lost = f"{n_lost} of {n_lost + len(gaps)} heartbeats are missing while SYNCs are answered"
    _need(not n_lost, f"{lost}; send them from a timer, and keep room for them in the send queue")


def _values(pdos: Sequence[PdoMap], frames: Iterable[Frame]) -> list[int]:
    """Return the readings in the TPDOs of a SYNC."""
    data = {frame.can_id: int.from_bytes(frame.data, "little") for frame in frames}
    values = []
    for pdo in pdos:
        for entry in readings_in(pdo):
            bits = data[pdo.cob_id] >> entry.offset & (1 << entry.bits) - 1
            values.append(bits - (bits >> entry.bits - 1 << entry.bits) * entry.signed)
    return values


def _sync_values(patch: PatchCheck) -> Script[list[int]]:
    """Return what the TPDOs after a SYNC carry; nothing if some do not come as they should."""
    received: list[Frame] = yield Listen(SYNC_PERIOD_NS, send=(Frame(cia.SYNC_ID, b""),))
    lengths = {frame.can_id: len(frame.data) for frame in received}
    is_whole = all(lengths.get(pdo.cob_id) == pdo.length for pdo in patch.pdos)
    return _values(patch.pdos, received) if is_whole else []


def _same_as_sdo(patch: PatchCheck) -> Check:
    """TPDOs carry what SDO reads, but for noise."""
    yield from patch.command(NmtCommand.START)
    subs = [entry.sub for pdo in patch.pdos for entry in readings_in(pdo)]
    by_pdo, by_sdo = [], []
    for _ in range(N_COMPARED):
        by_pdo.append((yield from _sync_values(patch)))
        by_sdo.append((yield from _counts(patch)))
    reads, noise = np.median(by_sdo, axis=0), np.ptp(by_sdo, axis=0)
    noise = np.maximum(noise, np.median(noise))  # of a few reads of one tactel it may be small by chance
    for sub, column in zip(subs, zip(*filter(None, by_pdo), strict=True), strict=False):
        seen, read = np.median(column), reads[sub - 1]
        near = (4 << _spare_bits(patch)) + 2 * noise[sub - 1] + abs(read) / 10
        off = f"reading {sub} is {seen:g} by PDO and {read:g} by SDO"
        is_near = abs(seen - read) <= near
        _need(is_near, f"{off}; send what 0x6401 holds: low byte first, not shifted, in this order")
    return "" if reads.any() else "all readings are 0, which proves little: use --press"


def _pressed(patch: PatchCheck) -> Check:
    """The same under a finger, where readings are large."""
    board = describe_patch(patch.od)
    if patch.ask:
        patch.ask("press the board with a finger, and hold until the next line")
    yield from patch.command(NmtCommand.START)
    for _ in range(PRESS_NS // SYNC_PERIOD_NS):
        values = yield from _sync_values(patch)
        if any(abs(v) * board.transducer.step > PRESSED * board.threshold for v in values):
            return (yield from _same_as_sdo(patch))
    _need(None, f"no press was felt within {PRESS_NS // (1000 * NS_PER_MS)} s")


def _left_adjusted(patch: PatchCheck) -> Check:
    """The bits below the converter's are 0."""
    spare = _spare_bits(patch)
    for sub, value in enumerate((yield from _counts(patch)), 1):
        _need(not value & ((1 << spare) - 1), f"reading {sub} is {value}: its lowest {spare} bits are not 0")


def _rests_in_band(patch: PatchCheck) -> Check:
    """Untouched, no tactel reads as if it were touched."""
    board = describe_patch(patch.od)
    offset = np.broadcast_to(board.offset, board.n_tactels)
    for sub, value in enumerate((yield from _counts(patch)), 1):
        pressure = (value - offset[sub - 1]) * board.transducer.step
        wanted = f"wanted within {board.threshold:g} Pa, the touch threshold, of its offset"
        _need(abs(pressure) <= board.threshold, f"reading {sub} is {pressure:.0f} Pa untouched; {wanted}")


def _limits(patch: PatchCheck) -> bytes:
    """Return limits of the guard that no reading can be above."""
    board = describe_patch(patch.od)
    limits = np.where(np.broadcast_to(board.healthy, board.n_tactels), NO_LIMIT - 1, NO_LIMIT)
    none = np.zeros(board.n_tactels, np.int64)
    return GuardLimits(1, 1, 2**31 - 1, limits, none, none).encode()


SCRIPTS: dict[str, Callable[[PatchCheck], Check]] = {
    "readings": _readings,
    "new samples": _new_samples,
    "channels": _channels,
    "heartbeat under load": _beats_under_load,
    "PDO as SDO": _same_as_sdo,
    "left-adjusted": _left_adjusted,
    "at rest": _rests_in_band,
    "pressed": _pressed,
}
"""Of rules without a dialogue."""

COMMANDS = {
    "pre": NmtCommand.PRE_OPERATIONAL,
    "op": NmtCommand.START,
    "stop": NmtCommand.STOP,
    "reset": NmtCommand.RESET_NODE,
    "comm": NmtCommand.RESET_COMMUNICATION,
}
