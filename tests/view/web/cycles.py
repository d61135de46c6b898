"""Cycles made by hand, of the arm "forearm" or another: what a test says is in them."""

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import TrackState
from skinbus.master.level_control import CycleFlags
from skinbus.master.patches.table import PatchState
from skinbus.skin.cycle import CONTACT, PATCH, Cycle, Now, Readings, SkinLayout, fill_places

ARM = load_arm("forearm")
LAYOUT = SkinLayout.of(ARM)


class MadeCycle(Cycle):
    """A cycle at 50 Hz; contacts are dicts of the fields of a record."""

    def __init__(self, number, contacts=(), *, states=None, pressures=None, valid=None, faults=None, arm=ARM):
        t_ns = number * 20_000_000
        layout = LAYOUT if arm is ARM else SkinLayout.of(arm)
        super().__init__(
            number, t_ns, number % 240 + 1, "fit", CycleFlags(0), 5e-3, layout, Now(None, t_ns + 5_000_000)
        )
        self._contacts = np.zeros(len(contacts), CONTACT)
        for record, contact in zip(self._contacts, contacts, strict=True):
            record["id"], record["state"], record["level"] = 1, TrackState.HELD, 1
            for key, value in contact.items():
                record[key] = value
        fill_places(self._contacts, arm)
        self._patches = np.zeros(arm.n_patches, PATCH)
        self._patches["state"], self._patches["last_fresh_ns"] = PatchState.OPERATIONAL, t_ns
        for p, state in (states or {}).items():
            self._patches["state"][p] = state
        n = arm.n_tactels
        self.readings = Readings(
            np.zeros(n) if pressures is None else pressures,
            np.ones(n, np.bool_) if valid is None else valid,
            np.zeros(n, np.uint8) if faults is None else faults,
        )

    @property
    def records(self):
        return self._contacts

    @property
    def patch_records(self):
        return self._patches
