"""What the estimator makes of a few inputs, as numbers on standard output: one JSON object.

Run by ``test_same_bits`` with and without compilation: ``python -m tests.hard.bits``.
"""

import json
import sys
from functools import cache

import numpy as np

from skinbus.estimate import LEVELS, Estimator
from tests.hard.catalogue import CASES
from tests.hard.ground import Ground

WORK = 40_000
"""Pressures evaluated in a cycle: of what nothing explains they would be millions."""
CHOSEN = (
    *("on a tactel", "on a corner of four boards", "strong beside weak, 1000:1", "noise alone"),
    *("on a seam", "saturated in the middle", "between two"),
    *("one stuck at full scale under the contact", "one reads nan"),
)
COLUMNS = ("link", "s", "a", "force", "quality", "status", "size", "residual", "covariance")


def contacts_of(ground):
    """Columns of the contacts of every level, in cases that go through the usual path and around it."""
    out, made = {}, cache(Estimator)  # uncompiled, most of the time goes into a new one
    for name in CHOSEN:
        _, build, *values = CASES[name]
        situation = build(ground, *values)
        rng, estimator = np.random.default_rng(5), made(situation.arm, "full", budget_work=WORK)
        pressures = situation.pressures + 200.0 * rng.standard_normal(len(situation.pressures))
        for level in LEVELS:
            contacts = estimator.update(pressures, 1, level=level)
            columns = [np.ravel(getattr(contacts, column)) for column in COLUMNS]
            out[f"{ground} {level} {name}"] = np.concatenate(columns)
    return out


if __name__ == "__main__":
    answers = contacts_of(Ground("cylinder", "cone")) | contacts_of(Ground("frustum", "radial"))
    json.dump({name: [float(v).hex() for v in values] for name, values in answers.items()}, sys.stdout)
