"""A check of one patch on a bus: rules are scripts that send, listen and transfer; each passes or fails."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import Any, Final

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import RTR, Frame
from skinbus.master.commissioning.sessions import Reply, Request
from skinbus.node.lss import FRAME_LENGTH, Lss
from skinbus.node.nmt import nmt_frame
from skinbus.node.sdo_client import SdoClient
from skinbus.objects import cia
from skinbus.objects.board import describe_patch
from skinbus.objects.pdo import PdoMap, carries_readings, tpdos
from skinbus.objects.profile import number_at

BOOT_NS: Final = 2_000_000_000
"""A board that has not booted after this has none of the loaders that are in use, which take 1 s at most."""
MS: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Send:
    """Send frames; the script goes on at once."""

    frames: tuple[Frame, ...]


@dataclass(frozen=True, slots=True)
class Listen:
    """Collect all frames for a time, or until one that ``until`` accepts has come, which is the last."""

    ns: int
    until: Callable[[Frame], bool] | None = None


class Grade(Enum):
    """What came of a rule."""

    PASS = "pass"
    FAIL = "FAIL"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Grading:
    """A grade, and what was seen."""

    grade: Grade
    detail: str = ""


PASSED: Final = Grading(Grade.PASS)
TIMEOUTS_NS: Final = 500 * MS, 5_000 * MS
"""Of an SDO answer, and of that to a store command: flash is slow."""

Check = Generator["Request | Send | Listen", Any, Grading]
"""A script: it is sent a ``Reply``, None, or the frames received."""


@dataclass(frozen=True, slots=True)
class Rule:
    """One line of the checklist."""

    name: str
    section: str
    """Where CiA 301, 305 or 401 says so; "skinbus" for what is our own."""
    text: str
    """What the firmware must do."""
    check: Callable[[CheckedPatch], Check]
    is_destructive: bool = False
    """Whether the parameters stored in the patch are lost."""


@dataclass(slots=True)
class CheckedPatch:
    """The patch under check: its node-ID, what its EDS says, and the limits that are asked of it."""

    node_id: int
    od: ObjectDictionary
    response_ns: int
    """Longest time from SYNC to the last of its TPDOs."""
    now_ns: int = 0

    def nmt(self, command: cia.NmtCommand) -> Send:
        """Command the patch."""
        return Send((nmt_frame(command, self.node_id),))

    def sync(self, counter: int = 0) -> Send:
        """Send SYNC, with a counter unless it is 0."""
        return Send((Frame(cia.SYNC_ID, bytes([counter]) if counter else b""),))

    def is_heartbeat(self, frame: Frame) -> bool:
        """Whether a frame is a heartbeat or boot-up of the patch."""
        return frame.can_id == cia.HEARTBEAT_BASE + self.node_id and not frame.flags

    def is_boot_up(self, frame: Frame) -> bool:
        """Whether a frame is the boot-up message of the patch."""
        return self.is_heartbeat(frame) and frame.data == b"\0"

    def is_emcy(self, frame: Frame) -> bool:
        """Whether a frame is an EMCY message of the patch."""
        return frame.can_id == cia.EMCY_BASE + self.node_id and not frame.flags


@dataclass(frozen=True, slots=True)
class RuleResult:
    """A rule and what came of it."""

    rule: Rule
    finding: Grading


class PatchCheck(Core):
    """A core that goes through the rules one after another and then asks its host to stop."""

    cob_ids = None

    def __init__(
        self,
        patch: CheckedPatch,
        rules: Sequence[Rule],
        *,
        destructive: bool = False,
        on_result: Callable[[RuleResult], object] | None = None,
    ) -> None:
        """``destructive``: rules by which stored parameters are lost are checked too."""
        self.results: list[RuleResult] = []
        self._patch = patch
        self._rules = rules
        self._destructive = destructive
        self._on_result = on_result
        self._script = self._run()
        self._client: SdoClient | None = None
        self._listen: Listen | None = None
        self._end_ns = NEVER
        self._received: list[Frame] = []
        self._started = False

    @property
    def passed(self) -> bool:
        """Whether no rule has failed."""
        return all(result.finding.grade is not Grade.FAIL for result in self.results)

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        out: list[Frame] = []
        self._patch.now_ns = now_ns
        if not self._started:
            self._started = True
            self._advance(now_ns, None, out)
        elif self._client is not None:
            self._transfer(now_ns, self._client, frames, out)
        elif self._listen is not None:
            self._collect(now_ns, self._listen, frames, out)
        if self._client is not None:
            return Step(out, (), self._client.wake_ns)
        if self._listen is not None:
            return Step(out, (), self._end_ns)
        return Step(out, [Event(t_ns=now_ns, kind=EventKind.STOP)], NEVER)

    def _transfer(self, now_ns: int, client: SdoClient, frames: Sequence[Frame], out: list[Frame]) -> None:
        out += client.step(now_ns, [frame for frame in frames if frame.can_id == client.answer_id])
        if client.result is not None:
            self._client = None
            self._advance(now_ns, Reply(client.result.data, client.result.abort or 0), out)

    def _collect(self, now_ns: int, listen: Listen, frames: Sequence[Frame], out: list[Frame]) -> None:
        for frame in frames:
            self._received.append(frame._replace(t_ns=frame.t_ns or now_ns))
            if listen.until is not None and listen.until(frame):
                break
        else:
            if now_ns < self._end_ns:
                return
        self._listen = None
        received, self._received = self._received, []
        self._advance(now_ns, received, out)

    def _advance(self, now_ns: int, answer: Any, out: list[Frame]) -> None:
        """Give the script an answer and run its next request, up to what takes time."""
        while True:
            try:
                action = self._script.send(answer)
            except StopIteration:
                return
            match action:
                case Send(frames):
                    out += frames
                    answer = None
                case Listen(ns):
                    self._listen, self._end_ns = action, now_ns + ns
                    return
                case Request(index, sub, data):
                    is_store = index in (cia.STORE_PARAMETERS, cia.RESTORE_DEFAULTS) and data is not None
                    self._client = SdoClient(self._patch.node_id, timeout_ns=TIMEOUTS_NS[is_store])
                    if data is None:
                        self._client.start_read(index, sub)
                    else:
                        self._client.start_write(index, sub, data)
                    out += self._client.step(now_ns, ())
                    return

    def _run(self) -> Generator[Request | Send | Listen, Any, None]:
        patch = self._patch
        for rule in self._rules:
            if rule.is_destructive and not self._destructive:
                finding = Grading(Grade.SKIPPED, "stored parameters would be lost")
            else:
                finding = yield from rule.check(patch)
            result = RuleResult(rule, finding)
            self.results.append(result)
            if self._on_result:
                self._on_result(result)
        # the rules have changed parameters: a reset brings the stored ones back
        yield patch.nmt(cia.NmtCommand.RESET_NODE)
        yield Listen(BOOT_NS, patch.is_boot_up)


def failed(detail: str) -> Grading:
    """Return the finding of a rule that is broken."""
    return Grading(Grade.FAIL, detail)


HEARTBEAT_MS: Final = 100
N_SYNCS: Final = 25
"""SYNCs that are answered: at 20 ms, half a second."""
SYNC_PERIOD_NS: Final = 20 * MS
ANSWER_NS: Final = 100 * MS
"""For what a node does at once: an EMCY, a change of state."""
MISSING_INDEX: Final = 0x5FFF


def _boots(patch: CheckedPatch) -> Check:
    yield Listen(ANSWER_NS)  # it may be booting
    yield patch.nmt(cia.NmtCommand.RESET_NODE)
    received = yield Listen(BOOT_NS, patch.is_boot_up)
    if not received or not patch.is_boot_up(received[-1]):
        return failed(f"no boot-up message within {BOOT_NS // MS} ms of a reset")
    before = [f for f in received[:-1] if f.can_id & 0x7F == patch.node_id and not patch.is_heartbeat(f)]
    return failed(f"sent 0x{before[0].can_id:03X} before its boot-up message") if before else PASSED


def _identity(patch: CheckedPatch) -> Check:
    places = [(cia.DEVICE_TYPE, 0), *((cia.IDENTITY, k) for k in range(1, 4))]
    for index, sub in places:
        reply = yield Request(index, sub)
        wanted = number_at(patch.od, index, sub)
        if reply.abort:
            return _aborted(index, sub, reply)
        seen = int.from_bytes(reply.data, "little")
        if wanted and seen != wanted:
            return failed(f"0x{index:04X}:{sub:02X} is 0x{seen:08X}; the EDS says 0x{wanted:08X}")
    return PASSED


def _heartbeat(patch: CheckedPatch) -> Check:
    reply = yield _write(cia.HEARTBEAT_PRODUCER, 0, HEARTBEAT_MS, 2)
    if reply.abort:
        return _aborted(cia.HEARTBEAT_PRODUCER, 0, reply)
    received = yield Listen((6 * HEARTBEAT_MS + HEARTBEAT_MS // 2) * MS)
    times = [f.t_ns for f in received if patch.is_heartbeat(f)]
    if len(times) < 5:
        return failed(f"{len(times)} heartbeats in {6 * HEARTBEAT_MS} ms at a period of {HEARTBEAT_MS} ms")
    worst = max(abs(b - a - HEARTBEAT_MS * MS) for a, b in pairwise(times[1:]))
    if worst > 0.2 * HEARTBEAT_MS * MS:  # consumers wait 1.5 periods and more
        return failed(f"heartbeats up to {worst / MS:.0f} ms off their period of {HEARTBEAT_MS} ms")
    return PASSED


def _states(patch: CheckedPatch) -> Check:
    yield _write(cia.HEARTBEAT_PRODUCER, 0, HEARTBEAT_MS, 2)
    steps = [
        (cia.NmtCommand.START, cia.NmtState.OPERATIONAL),
        (cia.NmtCommand.STOP, cia.NmtState.STOPPED),
        (cia.NmtCommand.PRE_OPERATIONAL, cia.NmtState.PRE_OPERATIONAL),
    ]
    for command, state in steps:
        yield patch.nmt(command)
        received = yield Listen(3 * HEARTBEAT_MS * MS)
        beats = [f.data for f in received if patch.is_heartbeat(f)]
        if not beats or beats[-1] != bytes([state]):
            seen = beats[-1].hex() if beats else "none"
            return failed(f"after {command.name} the heartbeat is {seen}, not {state:02x} ({state.name})")
    return PASSED


def _silent_before_start(patch: CheckedPatch) -> Check:
    yield patch.nmt(cia.NmtCommand.PRE_OPERATIONAL)
    yield Listen(ANSWER_NS)
    yield patch.sync()
    received = yield Listen(ANSWER_NS)
    ids = {pdo.cob_id for pdo in tpdos(patch.od) if pdo.valid}
    sent = [f for f in received if f.can_id in ids]
    return failed(f"sent PDO 0x{sent[0].can_id:03X} in PRE-OPERATIONAL") if sent else PASSED


def _stopped(patch: CheckedPatch) -> Check:
    yield patch.nmt(cia.NmtCommand.STOP)
    yield Listen(ANSWER_NS)
    reply: Reply = yield Request(cia.DEVICE_TYPE, 0)
    yield patch.nmt(cia.NmtCommand.PRE_OPERATIONAL)
    yield Listen(ANSWER_NS)
    return PASSED if reply.is_silent else failed("answers SDO requests in STOPPED")


def _aborts(patch: CheckedPatch) -> Check:
    wrong = [
        (Request(MISSING_INDEX, 0), "read of a missing object", {cia.AbortCode.NO_OBJECT}),
        (Request(cia.IDENTITY, 0x7F), "read of a missing sub-index", {cia.AbortCode.NO_SUB_INDEX}),
        (Request(cia.DEVICE_TYPE, 0, bytes(4)), "write to a constant", {cia.AbortCode.READ_ONLY}),
        (
            Request(cia.HEARTBEAT_PRODUCER, 0, bytes(4)),
            "write of four bytes to an UNSIGNED16",
            {cia.AbortCode.LENGTH_HIGH, cia.AbortCode.LENGTH},
        ),
        (
            Request(cia.HEARTBEAT_PRODUCER, 0, bytes(1)),
            "write of one byte to an UNSIGNED16",
            {cia.AbortCode.LENGTH_LOW, cia.AbortCode.LENGTH},
        ),
    ]
    for request, what, codes in wrong:
        reply = yield request
        if reply.abort not in codes:
            wanted = " or ".join(f"0x{code:08X}" for code in sorted(codes))
            seen = f"aborted with 0x{reply.abort:08X}" if reply.abort else "accepted"
            return failed(f"{what} was {seen}; wanted {wanted}")
    return PASSED


def _communication(patch: CheckedPatch) -> Check:
    for pdo in tpdos(patch.od):
        places = [(cia.TPDO_COMMUNICATION, sub) for sub in (cia.PDO_COB_ID, cia.PDO_TYPE)]
        places += [(cia.TPDO_MAPPING, sub) for sub in range(len(pdo.entries) + 1)]
        for base, sub in places:
            index = base + pdo.number - 1
            reply = yield Request(index, sub)
            if reply.abort:
                return _aborted(index, sub, reply)
            seen, wanted = int.from_bytes(reply.data, "little"), number_at(patch.od, index, sub)
            if seen != wanted:
                return failed(f"0x{index:04X}:{sub:02X} is 0x{seen:X}; the EDS says 0x{wanted:X}")
    return PASSED


def _readings(patch: CheckedPatch) -> Check:
    """Every SYNC is answered once by every TPDO of readings, in time, with a sample of its own."""
    pdos, rounds = _cyclic(patch), []
    yield patch.nmt(cia.NmtCommand.START)
    yield Listen(ANSWER_NS)
    slowest = 0
    for _ in range(N_SYNCS):
        sent_ns = patch.now_ns
        yield patch.sync()
        received = yield Listen(SYNC_PERIOD_NS)
        for pdo in pdos:
            frames = [f for f in received if f.can_id == pdo.cob_id]
            if len(frames) != 1:
                return failed(f"TPDO {pdo.number} came {len(frames)} times after a SYNC")
            if len(frames[0].data) != pdo.length:
                return failed(f"TPDO {pdo.number} has {len(frames[0].data)} bytes; wanted {pdo.length}")
            slowest = max(slowest, frames[0].t_ns - sent_ns)
        rounds.append([f.data for pdo in pdos for f in received if f.can_id == pdo.cob_id])
    # a board without noise may repeat; with noise all its TPDOs change
    n_same = sum(a == b for a, b in pairwise(rounds))
    n_new = sum(all(x != y for x, y in zip(a, b, strict=True)) for a, b in pairwise(rounds))
    if min(n_same, n_new) > 1 and n_same + n_new == len(rounds) - 1:
        return failed(
            f"{n_same} of {len(rounds)} answers repeat the one before; wanted a new sample for each SYNC"
        )
    detail = f"SYNC to the last TPDO: {slowest / MS:.2f} ms at most"
    if slowest > patch.response_ns:
        return failed(f"{detail}; wanted {patch.response_ns / MS:g} ms")
    return Grading(Grade.PASS, detail)


def _left_adjusted(patch: CheckedPatch) -> Check:
    """The bits below the converter's are 0, and PDOs carry what SDO reads."""
    transducer = describe_patch(patch.od).transducer
    spare = transducer.bits - (transducer.converter_bits or transducer.bits)
    for sub, request in _requests_of_readings(patch):
        reply = yield request
        if reply.abort:
            return _aborted(request.index, sub, reply)
        value = int.from_bytes(reply.data, "little", signed=True)
        if value & ((1 << spare) - 1):
            return failed(f"reading {sub} is {value}: its lowest {spare} bits are not 0")
    return PASSED


def _rests_in_band(patch: CheckedPatch) -> Check:
    """Untouched, no tactel reads as if it were touched."""
    board = describe_patch(patch.od)
    step = board.transducer.step
    for sub, request in _requests_of_readings(patch):
        reply = yield request
        if reply.abort:
            return _aborted(request.index, sub, reply)
        offset = 0.0 if board.offset is None else float(board.offset[sub - 1])
        pressure = (int.from_bytes(reply.data, "little", signed=True) - offset) * step
        if abs(pressure) > board.threshold:
            said = f"reading {sub} is {pressure:.0f} Pa untouched"
            return failed(f"{said}; wanted within {board.threshold:g} Pa, the touch threshold, of its offset")
    return PASSED


def _emcy(patch: CheckedPatch) -> Check:
    """A SYNC of eight bytes is an error, and the next right one ends it."""
    yield patch.nmt(cia.NmtCommand.PRE_OPERATIONAL)
    yield Listen(ANSWER_NS)
    yield Send((Frame(cia.SYNC_ID, bytes(8)),))
    received = yield Listen(ANSWER_NS, patch.is_emcy)
    if not received or not patch.is_emcy(received[-1]):
        return failed("no EMCY message after a SYNC of eight bytes (0x8240)")
    code = int.from_bytes(received[-1].data[:2], "little")
    if code != cia.EmcyCode.SYNC_LENGTH or len(received[-1].data) != 8:
        return failed(f"EMCY {received[-1].data.hex()}; wanted 8 bytes with code 0x8240")
    register = yield Request(cia.ERROR_REGISTER, 0)
    if register.abort or not any(register.data):
        return failed("the error register is 0 while there is an error")
    history = yield Request(cia.ERROR_HISTORY, cia.LAST_ERROR)
    if history.abort or int.from_bytes(history.data[:2], "little") != code:
        return failed("the newest entry of the error history is not the error")
    yield patch.sync()
    received = yield Listen(ANSWER_NS, patch.is_emcy)
    if not received or received[-1].data[:2] != b"\0\0":
        return failed("no EMCY message with code 0 after the error has gone")
    register = yield Request(cia.ERROR_REGISTER, 0)
    return failed("the error register is not 0 after the error has gone") if any(register.data) else PASSED


def _window(patch: CheckedPatch) -> Check:
    reply = yield _write(cia.SYNC_WINDOW, 0, 10_000, 4)
    if reply.abort:
        return _aborted(cia.SYNC_WINDOW, 0, reply)
    reply = yield Request(cia.SYNC_WINDOW, 0)
    seen = int.from_bytes(reply.data, "little")
    yield _write(cia.SYNC_WINDOW, 0, 0, 4)
    return PASSED if seen == 10_000 else failed(f"reads {seen} after 10000 was written")


def _pdo_rules(patch: CheckedPatch) -> Check:
    """The mapping of a valid PDO stays."""
    pdo = _cyclic(patch)[0]
    reply = yield _write(cia.TPDO_MAPPING + pdo.number - 1, 0, 0, 1)
    if not reply.abort:
        yield _write(cia.TPDO_MAPPING + pdo.number - 1, 0, len(pdo.entries), 1)
        return failed("the mapping of a valid PDO could be changed")
    return PASSED


def _mark(patch: CheckedPatch) -> Check:
    """0x1020 is 0 as soon as a parameter is another."""
    for sub in (cia.VERIFY_DATE, cia.VERIFY_TIME):
        reply = yield _write(cia.VERIFY_CONFIGURATION, sub, 0x1234, 4)
        if reply.abort:
            return _aborted(cia.VERIFY_CONFIGURATION, sub, reply)
    yield _write(cia.HEARTBEAT_PRODUCER, 0, HEARTBEAT_MS + 1, 2)
    for sub in (cia.VERIFY_DATE, cia.VERIFY_TIME):
        reply = yield Request(cia.VERIFY_CONFIGURATION, sub)
        if any(reply.data):
            return failed(f"0x1020:{sub:02X} stays after a parameter was changed")
    return PASSED


def _guarding(patch: CheckedPatch) -> Check:
    yield _write(cia.HEARTBEAT_PRODUCER, 0, 0, 2)
    yield Listen(ANSWER_NS)  # a heartbeat may be on its way
    states = []
    for _ in range(2):
        yield Send((Frame(cia.HEARTBEAT_BASE + patch.node_id, b"", flags=RTR),))
        received = yield Listen(ANSWER_NS, patch.is_heartbeat)
        if not received or not patch.is_heartbeat(received[-1]) or len(received[-1].data) != 1:
            return failed("no answer to node guarding")
        states.append(received[-1].data[0])
    return PASSED if states[0] ^ states[1] == 0x80 else failed("the toggle bit does not alternate")


def _store(patch: CheckedPatch) -> Check:
    """What is stored comes back after a reset, and what is restored is the default."""
    reply = yield Request(cia.STORE_PARAMETERS, cia.STORE_ALL, b"evas")
    if not reply.abort:
        return failed("0x1010:01 takes a wrong signature")
    default = number_at(patch.od, cia.HEARTBEAT_PRODUCER)
    signatures = (
        (cia.STORE_PARAMETERS, cia.SIGNATURE_SAVE, default + 7),
        (cia.RESTORE_DEFAULTS, cia.SIGNATURE_LOAD, default),
    )
    yield _write(cia.HEARTBEAT_PRODUCER, 0, default + 7, 2)
    for index, signature, wanted in signatures:
        reply = yield _write(index, cia.STORE_ALL, signature, 4)
        if reply.abort:
            return _aborted(index, cia.STORE_ALL, reply)
        yield patch.nmt(cia.NmtCommand.RESET_NODE)
        yield Listen(BOOT_NS, patch.is_boot_up)
        reply = yield Request(cia.HEARTBEAT_PRODUCER, 0)
        seen = int.from_bytes(reply.data, "little")
        if seen != wanted:
            return failed(f"0x1017 is {seen} after 0x{index:04X} and a reset; wanted {wanted}")
    return PASSED


def _lss(patch: CheckedPatch) -> Check:
    """Selected by its identity, it answers with its node-ID, and no longer when it is let go."""
    yield patch.nmt(cia.NmtCommand.PRE_OPERATIONAL)
    yield Listen(ANSWER_NS)
    numbers = []
    for sub in range(cia.IDENTITY_VENDOR, cia.IDENTITY_SERIAL + 1):
        reply = yield Request(cia.IDENTITY, sub)
        if reply.abort:
            return _aborted(cia.IDENTITY, sub, reply)
        numbers.append(int.from_bytes(reply.data, "little"))
    select = [Lss.SWITCH_VENDOR + k for k in range(4)]
    yield Send(tuple(_lss_frame(c, n.to_bytes(4, "little")) for c, n in zip(select, numbers, strict=True)))
    received = yield Listen(ANSWER_NS, _is_lss)
    if not received or received[-1].data[:1] != bytes([Lss.SWITCHED]):
        return failed("does not answer LSS switch state selective with its identity")
    yield Send((_lss_frame(Lss.INQUIRE_NODE_ID),))
    received = yield Listen(ANSWER_NS, _is_lss)
    yield Send((_lss_frame(Lss.SWITCH_GLOBAL, b"\0"),))
    if not received or received[-1].data[:2] != bytes([Lss.INQUIRE_NODE_ID, patch.node_id]):
        return failed("does not answer LSS inquire node-ID")
    return PASSED


def _survives(patch: CheckedPatch) -> Check:
    junk = [
        Frame(cia.SDO_CLIENT_BASE + patch.node_id, b"\x40\x00\x10"),
        Frame(cia.SDO_CLIENT_BASE + patch.node_id, bytes([0xFF] * 8)),
        Frame(cia.NMT_COMMAND_ID, b"\x01"),
        Frame(cia.NMT_COMMAND_ID, bytes([0x55, patch.node_id])),
        Frame(cia.LSS_MASTER_ID, b"\x04"),
    ]
    yield Send(tuple(junk))
    yield Listen(ANSWER_NS)
    reply = yield Request(cia.DEVICE_TYPE, 0)
    return PASSED if not reply.abort else failed("does not answer after malformed frames")


def _cyclic(patch: CheckedPatch) -> list[PdoMap]:
    sync = range(1, cia.TransmissionType.SYNC_MAX + 1)
    return [pdo for pdo in tpdos(patch.od) if carries_readings(pdo) and pdo.transmission_type in sync]


def _requests_of_readings(patch: CheckedPatch) -> list[tuple[int, Request]]:
    index = next(i for i in cia.READINGS if i in patch.od.indices)
    return [(sub, Request(index, sub)) for sub in range(1, describe_patch(patch.od).n_tactels + 1)]


def _write(index: int, sub: int, value: int, size: int) -> Request:
    return Request(index, sub, value.to_bytes(size, "little"))


def _lss_frame(command: int, data: bytes = b"") -> Frame:
    return Frame(cia.LSS_MASTER_ID, (bytes([command]) + data).ljust(FRAME_LENGTH, b"\0"))


def _is_lss(frame: Frame) -> bool:
    return frame.can_id == cia.LSS_SLAVE_ID and not frame.flags


def _aborted(index: int, sub: int, reply: Reply) -> Grading:
    what = "not answered" if reply.is_silent else f"aborted with 0x{reply.abort:08X}"
    return failed(f"0x{index:04X}:{sub:02X}: {what}")


RULES: Final = (
    Rule("boot-up", "301 7.2.8.3.1.4", "A reset ends with the boot-up message, before any other.", _boots),
    Rule("identity", "301 7.5.2.19", "Device type and identity are those of the EDS.", _identity),
    Rule("heartbeat", "301 7.5.2.21", "The heartbeat keeps the period of 0x1017 within a fifth.", _heartbeat),
    Rule("states", "301 7.3.2.2", "NMT commands lead to their states, which the heartbeat shows.", _states),
    Rule("silence", "301 7.3.2.2.5", "No PDO is sent before the start.", _silent_before_start),
    Rule("stopped", "301 7.3.2.2.5", "SDO requests are not answered in STOPPED.", _stopped),
    Rule("SDO aborts", "301 7.2.4.3.17", "Wrong requests are aborted with the code of their fault.", _aborts),
    Rule("PDO parameters", "301 7.5.2.37", "PDO parameters are those of the EDS.", _communication),
    Rule("valid PDO", "301 7.5.2.38", "The mapping of a valid PDO cannot be changed.", _pdo_rules),
    Rule(
        "readings", "301 7.2.2", "Each SYNC has one answer in time, of all readings, sampled new.", _readings
    ),
    Rule("left-adjusted", "401 6.4", "Readings are left-adjusted: spare bits are 0.", _left_adjusted),
    Rule("at rest", "skinbus", "Untouched, no reading passes the touch threshold.", _rests_in_band),
    Rule("EMCY", "301 7.2.7", "Errors are sent once, kept in 0x1001 and 0x1003, and taken back.", _emcy),
    Rule("synchronous window", "301 7.5.2.7", "0x1007 can be set; late TPDOs are not sent.", _window),
    Rule("configuration mark", "301 7.5.2.24", "0x1020 is 0 once a parameter was changed.", _mark),
    Rule("node guarding", "301 7.2.8.2.2", "Without a heartbeat, remote frames are answered.", _guarding),
    Rule("LSS", "305 4.1", "LSS selects the board by its identity.", _lss),
    Rule(
        "storage", "301 7.5.2.13", "0x1010 stores and 0x1011 restores, with their signatures.", _store, True
    ),
    Rule("malformed frames", "301 7.2.4", "Malformed frames change nothing.", _survives),
)
"""In the order in which they are checked: last what may stop a board for good."""
