"""The LSS master (CiA 305): finds nodes by their identity and gives them node-IDs.

What is said on the bus is written as scripts: generators that yield an ``Exchange`` and are sent the answers.
Fastscan asks for the identity bit by bit, from the top: whoever's bits so far are the ones asked answers,
so that silence means a one. What is known beforehand (the vendor, most of all) is asked whole: one question
in place of 33. Of several nodes the one with the lowest identity is found first.
"""

from __future__ import annotations

import struct
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeVar

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.node.lss import FASTSCAN_ALL, Lss, Mode
from skinbus.objects import cia

DEFAULT_TIMEOUT_NS: Final = 20_000_000
"""What most masters give a slave to answer; fastscan waits so long for every one bit."""

STORE_FACTOR: Final = 50
"""A slave that writes to flash takes longer to answer, times the time-out: 1 s."""

BOOT_FACTOR: Final = 50
"""A slave that takes a node-ID boots with it in so many time-outs: 1 s."""

SETTLE_SHARE: Final = 4
"""After a first answer others are heard out for this fraction of the time-out: their answers look the same,
and one that comes late would be taken for the answer to the next question."""

LENGTH: Final = 8
BITS: Final = 32
_NUMBER: Final = struct.Struct("<BI")
_FASTSCAN: Final = struct.Struct("<BIBBB")

SWITCH_SELECTIVE: Final = (Lss.SWITCH_VENDOR, Lss.SWITCH_PRODUCT, Lss.SWITCH_REVISION, Lss.SWITCH_SERIAL)


class Address(NamedTuple):
    """The LSS address of a node, which no other node has: its identity, 0x1018."""

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        return f"{self.vendor:X}:{self.product:X}:{self.revision:X}:{self.serial}"


@dataclass(frozen=True, slots=True)
class Exchange:
    """Frames to send, and the answers to wait for: those that begin with ``first`` on ``can_id``.

    With ``hears_out`` the first answer is not the end: more may come. Without ``can_id`` it is a pause.
    """

    send: tuple[Frame, ...]
    can_id: int | None = cia.LSS_SLAVE_ID
    first: int = 0
    timeout_factor: float = 1.0
    hears_out: bool = False


T = TypeVar("T")
LssScript = Generator[Exchange, list[bytes], T]
"""A script is sent the answers to each exchange, none when time ran out."""


class LssSession:
    """Runs one script at a time: sends what it yields and collects the answers."""

    def __init__(self, *, timeout_ns: int = DEFAULT_TIMEOUT_NS) -> None:
        self.wake_ns = NEVER
        self._timeout_ns = timeout_ns
        self._script: LssScript[None] | None = None
        self._exchange: Exchange | None = None
        self._answers: list[bytes] = []

    @property
    def busy(self) -> bool:
        """Whether a script is going on."""
        return self._script is not None

    def begin(self, now_ns: int, script: LssScript[None]) -> list[Frame]:
        """Begin a script; return its first frames."""
        self._script = script
        return self._next(now_ns, None)

    def step(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Take frames; return what the script says next."""
        exchange = self._exchange
        if exchange is None:
            return []
        for frame in frames:
            if frame.can_id == exchange.can_id and frame.data[:1] == bytes([exchange.first]):
                if not self._answers and exchange.hears_out:
                    self.wake_ns = min(self.wake_ns, now_ns + self._timeout_ns // SETTLE_SHARE)
                self._answers.append(frame.data)
        if now_ns < self.wake_ns and not (self._answers and not exchange.hears_out):
            return []
        return self._next(now_ns, self._answers)

    def _next(self, now_ns: int, answers: list[bytes] | None) -> list[Frame]:
        assert self._script is not None
        self._answers = []
        try:
            self._exchange = next(self._script) if answers is None else self._script.send(answers)
        except StopIteration:
            self._script = self._exchange = None
            self.wake_ns = NEVER
            return []
        self.wake_ns = now_ns + round(self._exchange.timeout_factor * self._timeout_ns)
        return list(self._exchange.send)


def switch_all(mode: Mode) -> LssScript[None]:
    """Put all nodes into a mode; nobody answers, but all are given time."""
    yield Exchange((_request(Lss.SWITCH_GLOBAL, bytes([mode.value])),), None)


def select(address: Address) -> LssScript[bool]:
    """Put the node with this identity into configuration, if it is there."""
    frames = tuple(
        Frame(cia.LSS_MASTER_ID, _NUMBER.pack(command, number).ljust(LENGTH, b"\0"))
        for command, number in zip(SWITCH_SELECTIVE, address, strict=True)
    )
    answers = yield Exchange(frames, first=Lss.SWITCHED)
    return bool(answers)


def inquire_node_ids() -> LssScript[list[int]]:
    """Return the node-IDs of the nodes in configuration, 255 for none yet; there should be one."""
    answers = yield _ask(Lss.INQUIRE_NODE_ID, hears_out=True)
    return [answer[1] for answer in answers if len(answer) > 1]


def configure_node_id(node_id: int, old: int | None) -> LssScript[str]:
    """Give the node in configuration a node-ID; return what is wrong, or nothing.

    When it is not known who took it, all are given back ``old``, which they had (None: not known).
    """
    answers = yield _ask(Lss.CONFIGURE_NODE_ID, bytes([node_id]), hears_out=True)
    if len(answers) == 1:
        return "" if _is_good(answers[0]) else f"refused node-ID {node_id}"
    fault = same_identity(len(answers)) if answers else "did not answer when it was given a node-ID"
    if old is not None:
        back = yield _ask(Lss.CONFIGURE_NODE_ID, bytes([old]), hears_out=True)
        if len(back) >= max(len(answers), 1) and all(map(_is_good, back)):
            return fault
    return f"{fault}; it may have taken node-ID {node_id}, which it has not stored: switch it off and on"


def same_identity(n: int) -> str:
    """What is wrong with n nodes of which LSS cannot tell one from another."""
    return f"{n} nodes have this identity, serial number and all; connect one at a time"


def store() -> LssScript[str]:
    """Let the node in configuration keep its node-ID; return what is wrong, or nothing."""
    answers = yield _ask(Lss.STORE, timeout_factor=STORE_FACTOR)
    if not answers:
        return "did not answer when it was to store"
    if not _is_good(answers[0]):
        return "cannot store its node-ID: it is lost when the node is switched off"
    return ""


def wait_for_boot_up(node_id: int, *commands: Frame) -> LssScript[bool]:
    """Return whether a node shows up with a boot-up message, after commands that make it do so."""
    answers = yield Exchange(commands, cia.HEARTBEAT_BASE + node_id, 0, BOOT_FACTOR)
    return bool(answers)


def fastscan(hints: Sequence[Sequence[int]] = ()) -> LssScript[Address | None]:
    """Find one node without node-ID and put it into configuration; None when there is none.

    ``hints`` are identities, or their first numbers, that are likely: each is tried whole.
    """
    if not (yield from _scan(0, FASTSCAN_ALL, 0, 0)):
        return None
    found: list[int] = []
    for part in range(len(Address._fields)):
        following = (part + 1) % len(Address._fields)
        likely = {h[part] for h in hints if len(h) > part and list(h[:part]) == found}
        number = yield from _scan_number(sorted(likely), part, following)
        if number is None:
            return None
        found.append(number)
    return Address(*found)


def _scan_number(likely: Sequence[int], part: int, following: int) -> LssScript[int | None]:
    """Find one number of an identity; None when whoever answered has fallen silent."""
    for number in likely:
        if (yield from _scan(number, 0, part, following)):
            return number
    number = 0
    for bit in reversed(range(BITS)):
        if not (yield from _scan(number, bit, part, part)):
            number |= 1 << bit
    return number if (yield from _scan(number, 0, part, following)) else None


def _scan(number: int, bit: int, part: int, following: int) -> LssScript[bool]:
    request = Frame(cia.LSS_MASTER_ID, _FASTSCAN.pack(Lss.FASTSCAN, number, bit, part, following))
    answers = yield Exchange((request,), first=Lss.IDENTIFIED, hears_out=True)
    return bool(answers)


def _is_good(answer: bytes) -> bool:
    """Whether an answer says that a node has done as it was told."""
    return answer[1:2] == b"\0"


def _ask(
    command: Lss, data: bytes = b"", *, timeout_factor: float = 1.0, hears_out: bool = False
) -> Exchange:
    return Exchange(
        (_request(command, data),), first=command, timeout_factor=timeout_factor, hears_out=hears_out
    )


def _request(command: Lss, data: bytes = b"") -> Frame:
    return Frame(cia.LSS_MASTER_ID, (bytes([command]) + data).ljust(LENGTH, b"\0"))
