"""New programs for boards (CiA 302-3), in the order that Zephyr's runner `canopen_program.py` has."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from skinbus.can.frame import Frame
from skinbus.errors import RemoteProtocolError
from skinbus.master.commissioning.sessions import Listen, NodesCore, Reply, Request, Script, Timeouts
from skinbus.node.context import NS_PER_MS
from skinbus.node.nmt import nmt_frame
from skinbus.node.sdo_client import expedited_write
from skinbus.objects import cia
from skinbus.objects.cia import NmtCommand
from skinbus.objects.program_image import read_image

LISTEN_NS = 100 * NS_PER_MS
"""For the SYNC of a master at work, for a change of state, and from one look at flash to the next."""
START_NS = 10_000 * NS_PER_MS
"""For the boot-up message of a new program, and for flash."""


class Flasher(NodesCore[str]):
    """A core that gives boards a program, side by side, and then asks its host to stop.

    Args:
        node_ids: of the boards.
        image: of the program, whole.
        asks_only: what they are and run; nothing is changed.
        advance: called with the number of segments that are sent.

    ``runs`` has the checksum of what each board that answers runs, ``results`` what went wrong, or nothing.
    """

    def __init__(
        self,
        node_ids: Iterable[int],
        image: bytes,
        timeouts: Timeouts | None = None,
        *,
        asks_only: bool = False,
        advance: Callable[[int], object] = lambda n: None,
    ) -> None:
        super().__init__(node_ids, timeouts, listens_ns=LISTEN_NS)
        self._image, self._head = image, read_image(image)
        self._asks_only = asks_only
        self._advance = advance
        self.runs: dict[int, int] = {}

    def _hear(self, frame: Frame) -> None:
        if frame.data[:1] in (b"\x20", b"\x30"):  # it has taken a segment
            self._advance(1)

    def _script(self, node_id: int) -> Script[str]:
        try:
            yield from self._flash(node_id)
        except RemoteProtocolError as fault:
            return str(fault)
        return ""

    def _flash(self, node_id: int) -> Script[None]:
        crc, vendor, product, _ = self._head
        for sub, wanted in ((cia.IDENTITY_VENDOR, vendor), (cia.IDENTITY_PRODUCT, product)):
            seen = yield from _ask(cia.IDENTITY, sub=sub)
            _need(seen == wanted, f"0x1018:{sub:02X} is 0x{seen:X}; the image is for 0x{wanted:X}")
        control = yield from _ask(cia.PROGRAM_CONTROL)
        yield from _ask(cia.FLASH_STATUS)
        self.runs[node_id] = seen = yield from _ask(cia.PROGRAM_SOFTWARE)
        if self._asks_only or (seen == crc and control == cia.PROGRAM_START):
            return
        if seen != crc or control != cia.PROGRAM_CONFIRM:  # what was stopped may wait for its start
            yield from self._download(node_id, crc)
        for nmt in (NmtCommand.START, NmtCommand.PRE_OPERATIONAL):  # OPERATIONAL confirms it, or a command
            yield Listen(LISTEN_NS, send=(nmt_frame(nmt, node_id),))
        if (yield from _ask(cia.PROGRAM_CONTROL)) == cia.PROGRAM_CONFIRM:
            yield from _ask(cia.PROGRAM_CONTROL, bytes([cia.PROGRAM_CONFIRM]))

    def _download(self, node_id: int, crc: int) -> Script[None]:
        yield Listen(LISTEN_NS, send=(nmt_frame(NmtCommand.PRE_OPERATIONAL, node_id),))
        for command in (cia.PROGRAM_STOP, cia.PROGRAM_CLEAR):
            yield from _ask(cia.PROGRAM_CONTROL, bytes([command]))
        yield from _ready()
        yield from _ask(cia.PROGRAM_DATA, self._image)
        yield from _ready()
        seen = yield from _ask(cia.PROGRAM_SOFTWARE)
        _need(seen == crc, f"its checksum after the download is 0x{seen:08X}")
        # by hand: the boot-up message may come with the answer
        start = expedited_write(cia.PROGRAM_CONTROL, 1, bytes([cia.PROGRAM_START]))
        send = Frame(cia.SDO_CLIENT_BASE + node_id, start)
        heard = yield Listen(START_NS, lambda frame: frame.data == b"\0", (send,))
        _need(
            bool(heard) and heard[-1].data == b"\0",
            "silent after the start; switched off and on, it runs its old program again",
        )
        self.runs[node_id] = seen = yield from _ask(cia.PROGRAM_SOFTWARE)
        _need(seen == crc, "it has started its old program again")


def _need(is_so: bool, otherwise: str) -> None:
    if not is_so:
        raise RemoteProtocolError(otherwise)


def _ask(index: int, data: bytes | None = None, sub: int = 1) -> Script[int]:
    """Read a number, or write; RemoteProtocolError where that is refused or not answered."""
    reply: Reply = yield Request(index, sub, data)
    what = "no answer" if reply.is_silent else cia.describe_abort(reply.abort)
    _need(not reply.abort, f"0x{index:04X}:{sub:02X}: {what}")
    return int.from_bytes(reply.data, "little")


def _ready() -> Script[None]:
    """Wait for flash, which may be erased and written beside the answers."""
    for _ in range(START_NS // LISTEN_NS):
        status = yield from _ask(cia.FLASH_STATUS)
        if status != cia.FLASH_BUSY:
            break
        yield Listen(LISTEN_NS)
    _need(not status, f"its flash is not ready: 0x1F57:01 is {status}")
