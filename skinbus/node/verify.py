"""How a manager verifies the configuration: 0x1020, and the checksum of what the pipeline depends on."""

from __future__ import annotations

from skinbus.node.context import Context, Part
from skinbus.node.layout import ImageEntry
from skinbus.node.storage import AREAS, COMMUNICATION, is_parameter
from skinbus.objects.cia import VERIFY_CONFIGURATION
from skinbus.objects.dcf import Write, checksum, is_verified
from skinbus.objects.profile import COMMUNICATION_CHECKSUM


class VerifyService(Part):
    """Sets 0x1020 to 0 when a client changes any other parameter (CiA 301, 7.5.2.24); computes the checksum.

    A manager reads 0x1020 to find out whether it has to configure the device again. Whoever writes it last,
    after the parameters, confirms them. It is 0 of a device that was never configured, and whatever another
    manager chose of one that was; the checksum is computed of what is held when it is read.
    """

    _is_altered = False
    """Whether a parameter that outlives a reset of the communication is another one."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        dictionary = self.dictionary
        self._subs = dictionary.layout.subs(VERIFY_CONFIGURATION)
        entries = dictionary.layout.entries.values()
        self._verified = [entry for entry in entries if is_verified(entry.index) and is_parameter(entry)]
        dictionary.on_stored = self._stored
        for entry in entries:
            if entry.variable.name == COMMUNICATION_CHECKSUM:
                dictionary.readers[entry.index] = self._checksum

    def loaded(self, *, application: bool) -> None:
        """After a reset: with stored values only those of the communication, what was altered still is."""
        if application:
            self._is_altered = False
        elif self._is_altered:
            self._clear()

    def _checksum(self, sub: int) -> bytes:
        load = self.values.load
        values = (Write(entry.index, entry.sub, load(entry) or b"") for entry in self._verified)
        return checksum(values).to_bytes(4, "little")

    def _stored(self, entry: ImageEntry) -> None:
        if entry.index == VERIFY_CONFIGURATION:
            self._is_altered = False
        elif is_parameter(entry):
            self._is_altered |= entry.index not in AREAS[COMMUNICATION]
            self._clear()

    def _clear(self) -> None:
        for sub in self._subs:
            self.values.put(VERIFY_CONFIGURATION, sub, 0)
