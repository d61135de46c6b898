"""The LSS master (CiA 305): finds nodes by their identity and gives them node-IDs.

Each service is a script (see ``sessions``). Fastscan asks for the identity bit by bit, from the top: a node
answers while the bits asked so far are its own, so that silence means a one. A number that is likely (the
vendor, most of all) is asked whole: one request in place of 33. Of several nodes the one with the lowest
identity is found first.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Exchange, Script
from skinbus.node.lss import FASTSCAN_ALL, Lss, Mode
from skinbus.objects import cia

STORE_FACTOR: Final = 50
"""A slave that writes to flash takes longer to answer, times the time-out: 1 s."""

BOOT_FACTOR: Final = 50
"""A slave that takes a node-ID boots with it in so many time-outs: 1 s."""

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


def switch_all(mode: Mode) -> Script[None]:
    """Put all nodes into a mode; nobody answers, but all are given time."""
    yield Exchange((switch_all_frame(mode),), None)


def switch_all_frame(mode: Mode) -> Frame:
    """Return the frame that puts all nodes into a mode."""
    return _request(Lss.SWITCH_GLOBAL, bytes([mode.value]))


def select(address: Address) -> Script[bool]:
    """Put the node with this identity into configuration, if it is there."""
    frames = tuple(
        Frame(cia.LSS_MASTER_ID, _NUMBER.pack(command, number).ljust(LENGTH, b"\0"))
        for command, number in zip(SWITCH_SELECTIVE, address, strict=True)
    )
    answers = yield Exchange(frames, first=Lss.SWITCHED)
    return bool(answers)


def inquire_node_ids() -> Script[list[int]]:
    """Return the node-IDs of the nodes in configuration, 255 for none yet; there should be one."""
    answers = yield _ask(Lss.INQUIRE_NODE_ID, awaits_all=True)
    return [answer[1] for answer in answers if len(answer) > 1]


def configure_node_id(node_id: int, old: int | None) -> Script[str]:
    """Give the node in configuration a node-ID; return what is wrong, or nothing.

    When it is not known which node took it, all get back ``old``, which they had (None: not known).
    """
    answers = yield _ask(Lss.CONFIGURE_NODE_ID, bytes([node_id]), awaits_all=True)
    if len(answers) == 1:
        return "" if _is_good(answers[0]) else f"refused node-ID {node_id}"
    fault = same_identity(len(answers)) if answers else "did not answer when it was given a node-ID"
    if old is not None:
        back = yield _ask(Lss.CONFIGURE_NODE_ID, bytes([old]), awaits_all=True)
        if len(back) >= max(len(answers), 1) and all(map(_is_good, back)):
            return fault
    return f"{fault}; it may have taken node-ID {node_id}, which it has not stored: switch it off and on"


def same_identity(n: int) -> str:
    """Return what is wrong with n nodes that LSS cannot distinguish."""
    return f"{n} nodes have this identity, serial number and all; connect one at a time"


def store() -> Script[str]:
    """Make the node in configuration store its node-ID; return what is wrong, or nothing."""
    answers = yield _ask(Lss.STORE, timeout_factor=STORE_FACTOR)
    if not answers:
        return "did not answer the store command"
    if not _is_good(answers[0]):
        return "cannot store its node-ID: it is lost when the node is switched off"
    return ""


def wait_for_boot_up(node_id: int, *commands: Frame) -> Script[bool]:
    """Return whether a node sends a boot-up message after commands that make it boot."""
    answers = yield Exchange(commands, cia.HEARTBEAT_BASE + node_id, 0, BOOT_FACTOR)
    return bool(answers)


def fastscan(hints: Sequence[Sequence[int]] = ()) -> Script[Address | None]:
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


def _scan_number(likely: Sequence[int], part: int, following: int) -> Script[int | None]:
    """Find one number of an identity; None when whoever answered has fallen silent."""
    for number in likely:
        if (yield from _scan(number, 0, part, following)):
            return number
    number = 0
    for bit in reversed(range(BITS)):
        if not (yield from _scan(number, bit, part, part)):
            number |= 1 << bit
    return number if (yield from _scan(number, 0, part, following)) else None


def _scan(number: int, bit: int, part: int, following: int) -> Script[bool]:
    request = Frame(cia.LSS_MASTER_ID, _FASTSCAN.pack(Lss.FASTSCAN, number, bit, part, following))
    answers = yield Exchange((request,), first=Lss.IDENTIFIED, awaits_all=True)
    return bool(answers)


def _is_good(answer: bytes) -> bool:
    """Whether an answer reports success."""
    return answer[1:2] == b"\0"


def _ask(
    command: Lss, data: bytes = b"", *, timeout_factor: float = 1.0, awaits_all: bool = False
) -> Exchange:
    return Exchange(
        (_request(command, data),), first=command, timeout_factor=timeout_factor, awaits_all=awaits_all
    )


def _request(command: Lss, data: bytes = b"") -> Frame:
    return Frame(cia.LSS_MASTER_ID, (bytes([command]) + data).ljust(LENGTH, b"\0"))
