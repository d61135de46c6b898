"""What the estimator makes of a few inputs, as numbers on standard output: one JSON object.

Run by ``test_same_bits`` with and without compilation: ``python -m tests.hard.bits``.
"""

import json
import sys

import numpy as np

from skinbus.estimate import Baseline, Estimator, Tracker
from tests.hard.ground import Ground, pressures_under, touch

PERIOD_NS = 20_000_000
WORK = 40_000
"""Pressures evaluated in a cycle: of what nothing explains they would be millions."""


def two_boards(surface, law):
    """Two boards side by side."""
    ground = Ground(surface, law)
    return ground.mount([ground.arm().patches[0].patch] * 2)


def readings(arm):
    """Cycles that go through the usual path and around it."""
    rng = np.random.default_rng(5)
    two = [touch(arm, 0, -0.007, 0.002, 6.0), touch(arm, 0, 0.008, 0.003, 5.0)]
    fields = {
        "one": [touch(arm, 0, 0.002, 0.001, 5.0)],
        "seam": [touch(arm, 0, 0.002, 0.0255, 40.0)],
        "two": two,
        "nothing": [],
    }
    for name, touches in fields.items():
        yield name, pressures_under(arm, touches) + 200.0 * rng.standard_normal(arm.n_tactels)
    broken = pressures_under(arm, two[:1])
    broken[[3, 9]] = np.nan, 250e3
    yield "broken", broken


def contacts_of(level):
    """Columns of the contacts of one level."""
    out = {}
    for surface, law in (("cylinder", "cone"), ("frustum", "radial")):
        arm = two_boards(surface, law)
        estimator = Estimator(arm, "full", budget_work=WORK)
        for name, pressures in readings(arm):
            c = estimator.update(pressures, 1, level=level)
            columns = [c.link, c.s, c.a, c.force, c.quality, c.status, c.size, c.residual]
            out[f"{surface} {law} {level} {name}"] = np.concatenate([*columns, c.covariance.ravel()])
    return out


def over_time():
    """Zeros, contacts and tracks of touches that come, cross and go."""
    arm = two_boards("cylinder", "cone")
    estimator, tracker, baseline = Estimator(arm), Tracker(arm), Baseline(arm)
    rng = np.random.default_rng(2)
    out = []
    for n in range(60):
        x = 0.002 * (n - 45) - 0.012
        touches = [touch(arm, 0, x, 0.004, 6.0), touch(arm, 1, -x, 0.0, 5.0)] if 45 < n < 57 else []
        pressures = pressures_under(arm, touches) + 200.0 * rng.standard_normal(arm.n_tactels)
        baseline.apply(pressures, n * PERIOD_NS)
        tracks = tracker.update(estimator.update(pressures, n, level="kmeans"), n * PERIOD_NS)
        out += [tracks.identity, tracks.state, tracks.mean.ravel(), tracks.covariance.ravel()]
    return {"tracks": np.concatenate(out), "zeros": baseline.zeros}


if __name__ == "__main__":
    out = contacts_of("kmeans") | contacts_of("fit") | contacts_of("full") | over_time()
    json.dump({name: [float(v).hex() for v in values] for name, values in out.items()}, sys.stdout)
