"""Errors of patches: what their EMCY messages and their answers say of them, in the column ``error``."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.master.patches.table import PatchTable
from skinbus.objects.cia import EmcyCode

EMCY_LENGTH: Final = 8

FIRST_ERROR: Final = 0x0100
"""EMCY codes below report that an error was reset, or that there is none (CiA 301, table 26)."""

Reported = tuple[EventKind, str]
"""What is new of a patch, and the detail of its event."""


def take_emcy(table: PatchTable, p: int, frame: Frame) -> Reported | None:
    """Take an EMCY of patch p; code 0x00xx says that an error is over, the register whether any is left.

    Which one is over it does not say (CiA 301, 7.2.7.1): the last code stays until all are.
    """
    code, register = int.from_bytes(frame.data[:2], "little"), frame.data[2]
    if code >= FIRST_ERROR:
        table.error[p] = code
        return EventKind.PATCH_EMCY, f"0x{code:04X}"
    if not register:
        table.error[p] = EmcyCode.NO_ERROR
        return EventKind.PATCH_EMCY_CLEARED, ""
    if table.error[p]:
        return None
    table.error[p] = EmcyCode.GENERIC  # an error whose EMCY was not received
    return EventKind.PATCH_EMCY, f"error register 0x{register:02X}"


def take_error(table: PatchTable, p: int, code: int | None) -> Reported | None:
    """Take what patch p answered: code of its last error, GENERIC for any, 0 for none, None: no answer."""
    before = table.error[p]
    if code is None or code == before or (before and code == EmcyCode.GENERIC):
        return None
    table.error[p] = code
    return (EventKind.PATCH_EMCY, f"0x{code:04X}") if code else (EventKind.PATCH_EMCY_CLEARED, "")


class Lengths:
    """Notes which patches send PDOs of a wrong length, and which no longer do."""

    def __init__(self, n_patches: int) -> None:
        self._seen = np.zeros(n_patches, np.int32)
        self._is_wrong = np.zeros(n_patches, np.bool_)

    def note(
        self, bad_length: npt.NDArray[np.int32], fresh: npt.NDArray[np.bool_]
    ) -> tuple[list[int], list[int]]:
        """Return the patches that have sent more of them since, and those whose readings are good again.

        bad_length: (n_patches,) PDOs of wrong length since the start.
        fresh:      (n_patches,) whether readings of the newest cycle are used.
        """
        worse = bad_length != self._seen
        if not (worse.any() or self._is_wrong.any()):
            return [], []
        good = self._is_wrong & fresh & (not worse.any())
        self._seen[:] = bad_length
        self._is_wrong = self._is_wrong & ~good | worse
        return np.flatnonzero(worse).tolist(), np.flatnonzero(good).tolist()
