"""A check of one patch on a bus: rules are scripts that send, listen and transfer; each passes or fails."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Reply, Request
from skinbus.node.nmt import nmt_frame
from skinbus.node.sdo_client import SdoClient
from skinbus.objects import cia

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
