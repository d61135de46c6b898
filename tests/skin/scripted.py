"""Cycles made by hand, for what needs no master."""

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import TrackState
from skinbus.master.level_control import CycleFlags
from skinbus.skin.cycle import CONTACT, UNKNOWN_LEVEL, Cycle, Now, SkinLayout

LAYOUT = SkinLayout.of(load_arm("pad"))


class ScriptedCycle(Cycle):
    """A cycle with these contacts: (id, state), or (id, state, identity)."""

    def __init__(self, number, *contacts):
        t_ns = number * 10_000_000
        super().__init__(number, t_ns, 1, "fit", CycleFlags(0), 1e-3, LAYOUT, Now(None, t_ns))
        self._made = np.zeros(len(contacts), CONTACT)
        for record, (key, state, *identity) in zip(self._made, contacts, strict=True):
            record["id"], record["state"], record["force"] = key, TrackState[state], 1.0
            record["level"] = UNKNOWN_LEVEL
            record["identity"] = identity[0] if identity else 0

    @property
    def records(self):
        return self._made
