"""Cycles made by hand, of the arm "forearm" or another: what a test says is in them."""

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import TrackState
from skinbus.skin.contact import CONTACT
from skinbus.skin.cycle import PATCH, PatchState, Readings, SkinLayout, fill_places
from tests.skin.scripted import made_cycle as made

ARM = load_arm("forearm")
LAYOUT = SkinLayout.of(ARM)


def made_cycle(number, contacts=(), *, states=None, pressures=None, valid=None, faults=None, **changes):
    """A cycle at 50 Hz; contacts are dicts of the fields of a record."""
    t_ns, n = number * 20_000_000, ARM.n_tactels
    records = np.zeros(len(contacts), CONTACT)
    for record, contact in zip(records, contacts, strict=True):
        record["id"], record["state"], record["level"] = 1, TrackState.HELD, 1
        for key, value in contact.items():
            record[key] = value
    fill_places(records, ARM)
    patches = np.zeros(ARM.n_patches, PATCH)
    patches["state"], patches["last_fresh_ns"] = PatchState.OPERATIONAL, t_ns
    for p, state in (states or {}).items():
        patches["state"][p] = state
    readings = Readings(
        np.zeros(n) if pressures is None else pressures,
        np.ones(n, np.bool_) if valid is None else valid,
        np.zeros(n, np.uint8) if faults is None else faults,
    )
    same = {"records": records, "patch_records": patches, "readings": readings}
    return made(number, t_ns, LAYOUT, age_ns=5_000_000, **same | changes)


def busy_cycle(number=1):
    """Return a cycle of two contacts, a slope of pressures, a lost and a booting board."""
    contacts = [
        {"id": 1, "s": 0.076, "a": -0.05, "force": 6.0},
        {"id": 2, "s": 0.03, "a": -0.09, "force": 2.0},
    ]
    pressures = np.linspace(0.0, 30e3, ARM.n_tactels)
    lost = {7: PatchState.SILENT, 13: PatchState.BOOTING}
    return made_cycle(number, contacts, pressures=pressures, states=lost)
