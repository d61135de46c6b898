"""Dialogues of the check of a board: frames and transfers with what must come of them, read from a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.frame import RTR, Frame
from skinbus.master.commissioning.sessions import Listen, Reply, Request, Script
from skinbus.node.context import NS_PER_MS
from skinbus.node.nmt import nmt_frame
from skinbus.objects import cia
from skinbus.objects.cia import NmtCommand
from skinbus.objects.profile import number_at

ANSWER_NS: Final = 30 * NS_PER_MS
"""For answers to a frame; shorter than the times in the table."""
BOOT_NS: Final = 2_000 * NS_PER_MS
COMMANDS: Final = {
    "pre": NmtCommand.PRE_OPERATIONAL,
    "op": NmtCommand.START,
    "reset": NmtCommand.RESET_NODE,
}


class Dialogue(NamedTuple):
    """One rule."""

    name: str
    section: str
    text: str
    needs: Sequence[int]
    """Objects without which a board does not keep it; others are not asked."""
    is_destructive: bool
    steps: Sequence[str]


def load_dialogues() -> Iterator[Dialogue]:
    """Yield the rules of the table."""
    text = Path(__file__).with_suffix(".txt").read_text(encoding="utf-8")
    for block in text.split("\n# ")[1:]:
        head, *steps = block.strip().split("\n")
        name, section, what, needs = (part.strip() for part in head.split("|"))
        objects = [int(word, 16) for word in needs.split() if word != "store"]
        yield Dialogue(name, section, what, objects, "store" in needs, steps)


class Speaker:
    """Holds a dialogue with one board."""

    def __init__(self, node_id: int, od: ObjectDictionary) -> None:
        self.node_id, self.od = node_id, od
        self.heard: list[Frame] = []

    def hold(self, steps: Sequence[str]) -> Script[str]:
        """Go through the steps; return what was wrong, nothing if all went well."""
        yield from self._hear(nmt_frame(NmtCommand.PRE_OPERATIONAL, self.node_id))
        for number, step in enumerate(steps, 1):
            wrong = yield from self._take(*step.split())
            if wrong:
                return f"step {number}, {step}: {wrong}"
        return ""

    def _hear(self, *send: Frame, ns: int = ANSWER_NS) -> Script[None]:
        self.heard = yield Listen(ns, send=send)

    def _take(self, verb: str, *words: str) -> Script[str]:
        if verb in ("read", "write"):
            return (yield from self._transfer(verb, *words))
        if verb in ("off", "on"):
            index = int(words[0], 16)
            cob_id = number_at(self.od, index, cia.PDO_COB_ID)
            own = cob_id | cia.COB_ID_INVALID if verb == "off" else cob_id
            reply: Reply = yield Request(index, cia.PDO_COB_ID, own.to_bytes(4, "little"))
            return cia.describe_abort(reply.abort) if reply.abort else ""
        if verb in COMMANDS:
            ns = BOOT_NS if verb == "reset" else ANSWER_NS
            yield from self._hear(nmt_frame(COMMANDS[verb], self.node_id), ns=ns)
        elif verb == "++":
            yield from self._hear(ns=int(words[0]) * NS_PER_MS)
        elif verb in ("->", ">>", "=>"):
            frame = self._frame(words)
            is_filled = verb == "->" and frame.can_id & ~0x7F in (cia.SDO_CLIENT_BASE, 0x780)
            data = frame.data.ljust(8, b"\0") if is_filled else frame.data
            yield from self._hear(frame._replace(data=data, flags=RTR if verb == "=>" else 0))
        else:
            return self._compare(verb, self._frame(words))
        return ""

    def _frame(self, words: Sequence[str]) -> Frame:
        base, plus, _ = words[0].partition("+n")
        can_id = int(base, 16) + self.node_id * bool(plus)
        return Frame(can_id, bytes(int(word, 16) for word in words[1:]))

    def _compare(self, verb: str, wanted: Frame) -> str:
        """Return what is wrong with the frames that were heard with an identifier."""
        came = [frame.data for frame in self.heard if frame.can_id == wanted.can_id and not frame.flags & RTR]
        n, is_exact = len(came), verb == "=="
        is_right = came and (came[-1] == wanted.data if is_exact else came[-1].startswith(wanted.data))
        if verb == "--":
            return f"came {n} times" if came else ""
        if verb != "~~" and n != 1:
            return f"came {n} times"
        return "" if is_right else f"came as {came[-1].hex(' ') if came else 'nothing'}"

    def _transfer(self, verb: str, place: str, *words: str) -> Script[str]:
        """Read or write; an exclamation mark asks for an abort."""
        index, _, sub = place.partition(":")
        data = bytes(int(word, 16) for word in words if word not in "=!")
        asked = Request(int(index, 16), int(sub, 16), None if verb == "read" else data)
        reply: Reply = yield asked
        if "!" in words:
            return "" if reply.abort and not reply.is_silent else "was accepted"
        if reply.abort:
            return cia.describe_abort(reply.abort)
        same = verb == "write" or reply.data.startswith(data)
        return "" if same else f"is {reply.data.hex(' ')}"
