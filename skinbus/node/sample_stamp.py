"""The stamp of a sample: the counter of the SYNC it was taken for, and its status, for PDOs to carry."""

from __future__ import annotations

import canopen

from skinbus.node.context import Context
from skinbus.node.layout import key_of
from skinbus.objects.cia import ERROR_REGISTER
from skinbus.objects.profile import SAMPLE_COUNTER, SAMPLE_STATUS, SampleStatus, has, index_of


class SampleStamp:
    """Writes the stamp of each SYNC to the process image."""

    def __init__(self, context: Context) -> None:
        self.values = context.values
        table = context.values.layout
        self._at = [
            table.entries[key_of(*index_of(table.od, name))].offset
            for name in (SAMPLE_COUNTER, SAMPLE_STATUS)
        ]

    @staticmethod
    def fits(od: canopen.ObjectDictionary) -> bool:
        """Return whether a dictionary has the objects."""
        return has(od, SAMPLE_COUNTER)

    def write(self, counter: int, status: SampleStatus) -> None:
        """Stamp the sample of a SYNC; one that is older is of no SYNC, its counter is 0."""
        if self.values.number(ERROR_REGISTER, 0):
            status |= SampleStatus.ERROR
        memory = self.values.memory
        memory[self._at[0]] = 0 if status & SampleStatus.OLD else counter
        memory[self._at[1]] = status
