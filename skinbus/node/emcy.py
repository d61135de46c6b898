"""Errors of the device: the error register, the history and the EMCY messages, kept together.

An error is reported once when it occurs and once when it clears (code 0x0000, with the code that went in the
manufacturer bytes); messages keep the inhibit time apart, and wait while the state forbids them.
"""

from __future__ import annotations

import struct
from collections import deque

from skinbus.can.core import NEVER
from skinbus.can.frame import Frames
from skinbus.node.context import NS_PER_100US, Context
from skinbus.node.dictionary import SdoAbort, check_cob_id
from skinbus.node.nmt import SERVICES, Service
from skinbus.objects.cia import (
    COB_ID_INVALID,
    COB_ID_MASK_11,
    EMCY_COB_ID,
    EMCY_INHIBIT,
    ERROR_HISTORY,
    ERROR_REGISTER,
    AbortCode,
    EmcyCode,
    ErrorRegister,
)

MAX_WAITING = 32
"""Messages that may wait; beyond, the oldest is lost (the history still has its error)."""

RETRY_NS = 50_000_000
"""Pause before a message that did not go out is sent again: ten waiting frames take 11 ms at 125 kbit/s."""

MESSAGE = struct.Struct("<HB5s")

# First byte of the code -> bit of the register that CiA 301 table 26 gives it; the generic bit is always set.
REGISTER_BITS: dict[int, ErrorRegister] = {
    0x2: ErrorRegister.CURRENT,
    0x3: ErrorRegister.VOLTAGE,
    0x4: ErrorRegister.TEMPERATURE,
    0x8: ErrorRegister.COMMUNICATION,
    0xF: ErrorRegister.MANUFACTURER,
}


class EmcyService:
    """Keeps 0x1001, 0x1003 and the messages in step."""

    def __init__(self, context: Context) -> None:
        self.context, self.values, dictionary = context, context.values, context.dictionary
        self.wake_ns = NEVER
        self._active: dict[tuple[int, bytes], int] = {}
        self._waiting: deque[bytes] = deque(maxlen=MAX_WAITING)
        self._history: deque[int] = deque(maxlen=len(dictionary.layout.subs(ERROR_HISTORY)))
        self._free_ns = 0
        dictionary.rules[ERROR_HISTORY] = self._check_history
        dictionary.readers[ERROR_HISTORY] = self._read_history
        dictionary.writers[ERROR_HISTORY] = self._clear_history
        dictionary.rules[EMCY_COB_ID] = self._check_cob_id

    def reset(self) -> None:
        """Clear all errors, as at power-on; nothing is sent."""
        self._active.clear()
        self._waiting.clear()
        self._free_ns = 0
        self.wake_ns = NEVER
        self._write_register()
        self._clear_history()

    def raise_error(self, code: int, data: bytes = b"") -> bool:
        """An error came; False when it was there already (same code and data)."""
        if (code, data) in self._active:
            return False
        bits = REGISTER_BITS.get(code >> 12, ErrorRegister.GENERIC)
        self._active[code, data] = int(bits | ErrorRegister.GENERIC)
        self._write_register()
        self._history.appendleft(code | int.from_bytes(data[:2], "little") << 16)
        self._write_history()
        self._queue(code, data)
        return True

    def clear_error(self, code: int, data: bytes | None = None) -> bool:
        """An error went (``data`` None: all with this code); False when it was not there."""
        gone = [key for key in self._active if key[0] == code and data in (None, key[1])]
        for key in gone:
            del self._active[key]
            self._write_register()
            self._queue(EmcyCode.NO_ERROR, code.to_bytes(2, "little") + key[1][:3])
        return bool(gone)

    def report(self, code: int, data: bytes, *, is_there: bool) -> bool:
        """An error is there, or it is not; return whether that is news."""
        return (self.raise_error if is_there else self.clear_error)(code, data)

    def not_sent(self, now_ns: int, frames: Frames) -> None:
        """Keep our messages among these, which were not sent, for another try, until they are."""
        cob_id = self.values.number(EMCY_COB_ID, 0, COB_ID_INVALID)
        mine = [frame.data for frame in frames if frame.can_id == cob_id and not frame.flags]
        room = MAX_WAITING - len(self._waiting)
        self._waiting.extendleft(mine[: -room - 1 : -1])
        if mine:
            self._free_ns = now_ns + RETRY_NS
            self.wake_ns = self._free_ns

    def tick(self) -> None:
        """Send what waits, as the inhibit time and the state allow."""
        context = self.context
        if Service.EMCY not in SERVICES[context.state]:
            self.wake_ns = NEVER  # the next state change looks again
            return
        inhibit_ns = self.values.number(EMCY_INHIBIT, 0) * NS_PER_100US
        while self._waiting and context.now_ns >= self._free_ns:
            cob_id = self.values.number(EMCY_COB_ID, 0, COB_ID_INVALID)
            message = self._waiting.popleft()
            if not cob_id & COB_ID_INVALID:
                context.send(cob_id & COB_ID_MASK_11, message)
                self._free_ns = context.now_ns + inhibit_ns
        self.wake_ns = self._free_ns if self._waiting else NEVER

    def _queue(self, code: int, data: bytes) -> None:
        register = self.values.number(ERROR_REGISTER, 0)
        self._waiting.append(MESSAGE.pack(code, register, data))
        self.wake_ns = min(self.wake_ns, self._free_ns)

    def _write_register(self) -> None:
        register = 0
        for bits in self._active.values():
            register |= bits
        self.values.put(ERROR_REGISTER, 0, register)

    def _write_history(self) -> None:
        """Let the host read it, too."""
        for sub, value in enumerate((len(self._history), *self._history)) if self._history.maxlen else ():
            self.values.put(ERROR_HISTORY, sub, value)

    def _clear_history(self, sub: int = 0, data: bytes = b"") -> None:
        self._history.clear()
        self._write_history()

    def _read_history(self, sub: int) -> bytes:
        # CiA 301, 7.5.2.4: what is not there has no data, although its sub-index is in the EDS.
        if sub > len(self._history):
            raise SdoAbort(AbortCode.NO_DATA)
        return self._history[sub - 1].to_bytes(4, "little") if sub else bytes((len(self._history),))

    def _check_history(self, sub: int, data: bytes) -> None:
        if any(data):
            raise SdoAbort(AbortCode.VALUE_INVALID)

    def _check_cob_id(self, sub: int, data: bytes) -> None:
        """CiA 301, 7.5.2.17: the identifier of a valid EMCY stays, and is no other service's nor extended."""
        check_cob_id(int.from_bytes(data, "little"), self.values.number(EMCY_COB_ID, 0))
