"""The patch table: the state of every patch and what it sent last, as columns."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from skinbus.arrays import Bools
from skinbus.objects import cia

Mask = Bools
"""(n_patches,) which patches."""

MAX_MISSED = 3
"""Cycles in a row without readings after which an operational patch is SILENT: one lost frame is no alarm."""


class PatchState(IntEnum):
    """Values of "Patch state" in skin-master.eds."""

    UNUSED = 0
    """No patch with this node-ID in the arm file."""
    ABSENT = 1
    """Has never answered, or not since the bus was lost."""
    BOOTING = 2
    """Answers; identity and configuration are being checked."""
    WRONG = 3
    """Another device than the arm file asks for, one that refuses its configuration, or two boards under one
    node-ID: never started; its readings are not used, whoever starts it."""
    # from here on: was started and has not been booted anew since
    OPERATIONAL = 4
    """Sends readings."""
    SILENT = 5
    """Was operational; its heartbeat or its readings have stopped."""


OPERATIONAL, SILENT = PatchState.OPERATIONAL.value, PatchState.SILENT.value
"""For arrays, which compare members of an enumeration ten times as slowly."""


class PatchTable:
    """One row per patch of the arm.

    state (n_patches,) PatchState; last_heard (n_patches,) ns of the last heartbeat, last_boot_up (n_patches,)
    of the last boot-up message; last_fresh
    (n_patches,) ns of the SYNC for which the newest readings in use were sampled; missed (n_patches,)
    cycles in a row without; error (n_patches,) last EMCY code, 0 for none; starts (n_patches,) times that it
    began to run; restarts (n_patches,) times that it stopped running by itself; serial (n_patches,) serial
    number that it last had, 0 for not known; nmt (n_patches,) NMT state by
    its last heartbeat or command, 0 for not known.
    """

    def __init__(self, n_patches: int) -> None:
        self.state = np.full(n_patches, PatchState.ABSENT, np.uint8)
        self.last_heard, self.last_boot_up, self.last_fresh = np.zeros((3, n_patches), np.int64)
        self.missed, self.starts, self.restarts, self.serial = np.zeros((4, n_patches), np.int64)
        self.error = np.zeros(n_patches, np.uint16)
        self.nmt = np.zeros(n_patches, np.uint8)

    def part(self, patches: slice) -> PatchTable:
        """Return a live view of some rows."""
        part = PatchTable(0)
        for name, column in vars(self).items():
            setattr(part, name, column[patches])
        return part

    @property
    def is_running(self) -> Mask:
        """Return which patches were started and have not been booted anew since, (n_patches,)."""
        return self.state >= OPERATIONAL

    def enter(self, p: int, state: int) -> None:
        """Put patch p into a state."""
        self.starts[p] += self.state[p] < OPERATIONAL <= state
        self.state[p] = state

    def heartbeat(self, now_ns: int, p: int, state: int) -> None:
        """Note the state in a heartbeat of patch p; 0, a boot-up, leads to pre-operational."""
        self.last_heard[p] = now_ns
        if state == cia.NmtState.INITIALISING:
            self.last_boot_up[p] = now_ns
        self.nmt[p] = state or cia.NmtState.PRE_OPERATIONAL

    def note_readings(self, owing: Mask, fresh: Mask, can_return: Mask) -> tuple[Mask, Mask]:
        """Note who of those that owed readings has sent them; too many gaps in a row is silence.

        ``can_return`` (n_patches,) are no longer silent when they have sent theirs. Return the patches that
        have fallen silent, and those that are back.
        """
        self.missed[fresh] = 0
        self.missed[owing & ~fresh] += 1
        silent = (self.state == OPERATIONAL) & (self.missed >= MAX_MISSED)
        back = can_return & fresh & (self.state == SILENT)
        for p in np.flatnonzero(silent | back).tolist():
            self.enter(p, SILENT if silent[p] else OPERATIONAL)
        return silent, back
