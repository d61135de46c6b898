"""Program download (CiA 302-3: 0x1F50, 0x1F51, 0x1F56, 0x1F57).

The storage keeps the program that runs and a new one; neither is ever executed. A new program is on trial
from its start until the device is OPERATIONAL, or a client confirms it. Otherwise the next start gives it up,
if there is another.
"""

from __future__ import annotations

from skinbus.node.context import Context, Part
from skinbus.node.dictionary import SdoAbort
from skinbus.node.layout import key_of
from skinbus.node.storage import Storage
from skinbus.objects.cia import (
    IDENTITY,
    PROGRAM_CLEAR,
    PROGRAM_COMMANDS,
    PROGRAM_CONFIRM,
    PROGRAM_CONTROL,
    PROGRAM_DATA,
    PROGRAM_SOFTWARE,
    PROGRAM_START,
    PROGRAM_STOP,
    AbortCode,
    NmtState,
)
from skinbus.objects.program_image import read_image

PLACES = NEW, TRIED, RUNNING = "new program", "program on trial", "program"
"""Where the storage keeps checksum and image, in hexadecimal; the first that is there is shown."""


class ProgramService(Part):
    """Takes a new program; without a storage it lasts as long as the device."""

    is_restarting = False
    """Whether the device is to start again, as after power-on."""

    def __init__(self, context: Context, storage: Storage | None) -> None:
        super().__init__(context)
        self._kept: Storage = {} if storage is None else storage
        self._data = self.dictionary.layout.entries.get(key_of(PROGRAM_DATA, 1))
        self.dictionary.writers |= {PROGRAM_DATA: self._take, PROGRAM_CONTROL: self._command}
        self.start()

    def start(self) -> None:
        """Start a new program, or again the old one if the new one was not confirmed."""
        kept = self._kept
        self.is_restarting = False
        if NEW in kept:
            kept[TRIED if RUNNING in kept else RUNNING] = kept.pop(NEW)
        elif RUNNING in kept:
            kept.pop(TRIED, None)

    def show(self, control: int = PROGRAM_START) -> None:
        """Put what objects hold where they are read; an image is taken after a clear command only."""
        kept = self._kept
        if self._data is not None:
            self._data.writable = control == PROGRAM_CLEAR
            program = next((kept[place] for place in PLACES if place in kept), "0")
            self.values.put(PROGRAM_CONTROL, 1, PROGRAM_CONFIRM if TRIED in kept else control)
            self.values.put(PROGRAM_SOFTWARE, 1, int(program[:8], 16))

    def enter(self, state: NmtState) -> None:
        """Confirm a program that has got to OPERATIONAL."""
        if state is NmtState.OPERATIONAL and TRIED in self._kept:
            self._kept[RUNNING] = self._kept.pop(TRIED)
            self.show()

    def _command(self, sub: int, data: bytes) -> None:
        command = data[0]
        kept = self._kept
        if command not in PROGRAM_COMMANDS:
            raise SdoAbort(AbortCode.VALUE_INVALID)
        is_late = TRIED in kept and command != PROGRAM_CONFIRM
        if is_late or self.context.state is not NmtState.PRE_OPERATIONAL:
            raise SdoAbort(AbortCode.DEVICE_STATE)
        if command == PROGRAM_CLEAR:
            kept.pop(NEW, None)
        self.is_restarting = command == PROGRAM_START and NEW in kept
        if command == PROGRAM_CONFIRM:
            self.enter(NmtState.OPERATIONAL)
        else:
            self.show(command)

    def _take(self, sub: int, data: bytes) -> None:
        crc, *board = read_image(data) or (0,)
        if board[:2] != self.values.view(IDENTITY, 1, 2).tolist():
            raise SdoAbort(AbortCode.NOT_STORED)
        self._kept[NEW] = f"{crc:08x}{data.hex()}"
        self.show(PROGRAM_STOP)
