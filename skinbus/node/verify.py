"""Date and time of the configuration (0x1020): gone as soon as the configuration is another one."""

from __future__ import annotations

from typing import Final

from skinbus.node.context import Context
from skinbus.node.dictionary import Dictionary
from skinbus.node.layout import Entry
from skinbus.node.storage import AREAS, COMMUNICATION, is_parameter
from skinbus.objects.cia import VERIFY_CONFIGURATION


class VerifyService:
    """Sets 0x1020 to 0 when a client changes any other parameter (CiA 301, 7.5.2.24).

    A manager reads it to find out whether it has to configure the device again; so it must not say that all
    is as it was when it is not. Whoever writes it last, after the parameters, says that it is.
    """

    def __init__(self, context: Context, dictionary: Dictionary) -> None:
        self.values = context.values
        self._subs: Final = dictionary.layout.subs(VERIFY_CONFIGURATION)
        self._is_altered = False
        """Whether a parameter that outlives a reset of the communication is another one."""
        if self._subs:
            dictionary.on_stored = self._stored

    def loaded(self, *, application: bool) -> None:
        """After a reset: with stored values only those of the communication, what was altered still is."""
        if application:
            self._is_altered = False
        elif self._is_altered:
            self._clear()

    def _stored(self, entry: Entry) -> None:
        if entry.index == VERIFY_CONFIGURATION:
            self._is_altered = False
        elif is_parameter(entry):
            self._is_altered |= entry.index not in AREAS[COMMUNICATION]
            self._clear()

    def _clear(self) -> None:
        for sub in self._subs:
            self.values.put(VERIFY_CONFIGURATION, sub, 0)
