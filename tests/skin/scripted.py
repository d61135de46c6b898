"""Cycles made by hand, for what needs no master."""

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import TrackState
from skinbus.skin.contact import CONTACT, UNKNOWN_LEVEL, Context
from skinbus.skin.cycle import PATCH, Cycle, CycleFlags, PatchState, Readings, SkinLayout

LAYOUT = SkinLayout.of(load_arm("pad"))


def made_cycle(number, t_ns, layout=LAYOUT, *, records=None, age_ns=0, **changes):
    """A cycle of healthy patches that read nothing; its ages are those at so long after its SYNC."""
    patches, n = np.zeros(len(layout.node_id), PATCH), layout.n_tactels
    patches["state"], patches["last_fresh_ns"] = PatchState.OPERATIONAL, t_ns
    settings = {
        "counter": number % 240 + 1,
        "level": "fit",
        "flags": CycleFlags(0),
        "latency_s": 5e-3,
        "context": Context(layout, lambda: t_ns + age_ns),
        "records": np.zeros(0, CONTACT) if records is None else records,
        "patch_records": patches,
        "readings": Readings(np.zeros(n), np.ones(n, np.bool_), np.zeros(n, np.uint8)),
    }
    return Cycle(number, t_ns, **settings | changes)


def scripted(number, *contacts):
    """A cycle with these contacts: (id, state), or (id, state, identity)."""
    records = np.zeros(len(contacts), CONTACT)
    for record, (key, state, *identity) in zip(records, contacts, strict=True):
        record["id"], record["state"], record["force"] = key, TrackState[state], 1.0
        record["level"] = UNKNOWN_LEVEL
        record["identity"] = identity[0] if identity else 0
    return made_cycle(number, number * 10_000_000, records=records)
