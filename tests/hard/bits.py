"""What the estimator makes of a few inputs, as numbers on standard output: one JSON object.

Run by ``test_same_bits`` with and without compilation: ``python -m tests.hard.bits``.
"""

import json
import sys

import numpy as np

from skinbus.estimate import LEVELS, Baseline, Estimator, Tracker
from tests.hard.catalogue import CASES
from tests.hard.ground import Ground, pressures_under, touch

PERIOD_NS = 20_000_000
WORK = 40_000
"""Pressures evaluated in a cycle: of what nothing explains they would be millions."""
CHOSEN = (
    *("on a tactel", "on a seam", "strong beside weak, 1000:1", "noise alone"),
    *("one stuck at full scale under the contact", "one reads nan"),
)
COLUMNS = ("link", "s", "a", "force", "quality", "status", "size", "residual", "covariance")


def contacts_of(ground):
    """Columns of the contacts of every level, in cases that go through the usual path and around it."""
    out = {}
    for name in CHOSEN:
        _, build, *values = CASES[name]
        situation = build(ground, *values)
        rng, estimator = np.random.default_rng(5), Estimator(situation.arm, "full", budget_work=WORK)
        pressures = situation.pressures + 200.0 * rng.standard_normal(len(situation.pressures))
        for level in LEVELS:
            contacts = estimator.update(pressures, 1, level=level)
            columns = [np.ravel(getattr(contacts, column)) for column in COLUMNS]
            out[f"{ground} {level} {name}"] = np.concatenate(columns)
    return out


def over_time():
    """Zeros, contacts and tracks of touches that come, cross and go."""
    arm = Ground("cylinder", "cone").arm()
    estimator, tracker, baseline = Estimator(arm), Tracker(arm), Baseline(arm)
    rng, out = np.random.default_rng(2), []
    for n in range(60):
        x = 0.002 * (n - 45) - 0.012
        touches = [touch(arm, 0, x, 0.004, 6.0), touch(arm, 1, -x, 0.0, 5.0)] if 45 < n < 57 else []
        pressures = pressures_under(arm, touches) + 200.0 * rng.standard_normal(arm.n_tactels)
        baseline.apply(pressures, n * PERIOD_NS)
        tracks = tracker.update(estimator.update(pressures, n, level="kmeans"), n * PERIOD_NS)
        out += [tracks.identity, tracks.state, tracks.mean.ravel(), tracks.covariance.ravel()]
    return {"tracks": np.concatenate(out), "zeros": baseline.zeros}


if __name__ == "__main__":
    answers = contacts_of(Ground("cylinder", "cone")) | contacts_of(Ground("frustum", "radial")) | over_time()
    json.dump({name: [float(v).hex() for v in values] for name, values in answers.items()}, sys.stdout)
