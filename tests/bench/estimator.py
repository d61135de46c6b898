"""How good the estimator is, family by family, beside the limits; two trees of the project side by side.

    python -m tests.bench.estimator                           this tree, 100 cases of each family
    python -m tests.bench.estimator -n 200 --beside ../old    the same cases by another tree, in turns

A family is a skin and a draw of touches; both trees get the same readings. Errors are those of the cases with the
right count. "over 6 sd" is the share of contacts further off than six standard deviations without a flag.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from skinbus.estimate import Estimator
from skinbus.model import Arm
from skinbus.model.patch import grid
from skinbus.study.accuracy_draws import DRAWS, _two
from skinbus.study.skin_models import NOISE, SKINS, _plain_skin, cone_forearm, shipped_law

FLAGS = 1 | 2 | 4 | 8 | 16
PER_SKIN = 100
"""Cases after which another board is made and calibrated."""
LEAST = 3
"""Tactels that each touch alone brings to the threshold; others are drawn again."""


def boxed(diameter, arm=None):
    """Return a skin with the shipped law pressed by a disc of this diameter (m)."""
    return lambda rng: _plain_skin(
        arm or cone_forearm().with_law(shipped_law()), 0.5 * rng.uniform(*diameter), rng
    )


def dense(law):
    """Return 64 tactels 6.5 mm apart; their law is the truth."""

    def skin(rng):
        model = SKINS["pad"](rng)
        arm = Arm.single_patch(grid(8, 8, 0.0065)).with_law(law or model.arm.patches[0].patch.law)
        own, surface = arm.patches[0].patch.law, arm.links[0].surface

        def feel(touches):
            d = surface.distance(arm.tactel_s, arm.tactel_a, touches[:, :1], touches[:, 1:2])
            return sum(own.pressure(d[i], touches[i, 2]) for i in range(len(touches)))

        return type(model)(arm, feel, model.read, NOISE)

    return skin


def apart(count, least, force):
    """Draw touches on tactels' hull or on boards, ``least`` m from each other."""

    def of(arm):
        surface, low, high = arm.links[0].surface, arm.tactel_s.min(), arm.tactel_s.max()
        half = 0.5 * surface.period if surface.period else 0.0

        def draw(rng):
            k, found = rng.integers(count[0], count[1] + 1), []
            while len(found) < k:
                place = rng.uniform([low, -half or low], [high, half or high])
                if all(surface.distance(*place, *other[:2]) >= least for other in found):
                    found.append([*place, rng.uniform(*force)])
            return np.array(found)

        return draw

    return of


def over_tactels(arm):
    """Draw one touch within half a pitch of a tactel that is not at a rim of its board."""
    inner = [
        i
        for i in range(arm.n_tactels)
        if np.abs(
            arm.patches[arm.tactel_patch[i]].patch.tactels_uv[i - arm.patch_start[arm.tactel_patch[i]]]
        ).max()
        < 0.012
    ]

    def draw(rng):
        i = rng.choice(inner or range(arm.n_tactels))
        return np.array(
            [
                [
                    *(np.array([arm.tactel_s[i], arm.tactel_a[i]]) + rng.uniform(-5e-3, 5e-3, 2)),
                    rng.uniform(1.0, 10.0),
                ]
            ]
        )

    return draw


def family(skin, draw, **limits):
    return (
        SKINS[skin] if isinstance(skin, str) else skin,
        DRAWS[draw] if isinstance(draw, str) else draw,
        limits,
    )


FAMILIES = {
    f"{skin}: {draw}": family(skin, draw)
    for skin, draw in [
        ("pad", "one 2-20 N"),
        ("forearm", "seam"),
        ("pad", "two"),
        ("forearm", "two on seam"),
        ("finger", "one 5-20 N"),
        ("finger", "one 2 N"),
        ("finger", "two 15 mm"),
        ("tip", "one 5-20 N"),
        ("finger, thumb", "one 2-20 N"),
        ("finger, tip", "one 2-20 N"),
        ("box", "one 2-20 N"),
        ("box thumb", "one 2-20 N"),
        ("box tip", "one 2-20 N"),
        ("box forearm", "seam"),
        ("box forearm", "two on seam"),
        ("pad", "three"),
    ]
} | {
    "pad: two 15-25 mm": family("pad", _two(0.015, 0.025)),
    "finger: two 15-25 mm": family("finger", _two(0.015, 0.025)),
    "box: two 15-25 mm": family("box", _two(0.015, 0.025)),
    "64 tactels, cone: 4-6 at 13 mm": family(dense(None), apart((4, 6), 0.013, (2.0, 8.0))),
    "64 tactels, radial: 4-6 at 13 mm": family(dense(shipped_law()), apart((4, 6), 0.013, (2.0, 8.0))),
    "box forearm: finger over tactels": family(boxed((8e-3, 16e-3)), over_tactels),
    "box forearm: finger anywhere": family(boxed((8e-3, 16e-3)), apart((1, 1), 0.0, (1.0, 10.0))),
    "forearm: five anywhere": family("forearm", apart((5, 5), 0.03, (5.0, 20.0))),
    "box forearm: five anywhere": family("box forearm", apart((5, 5), 0.03, (5.0, 20.0))),
}


def measure(name, n):
    """Return the row of each level of a family."""
    make, draw_of, _ = FAMILIES[name]
    rows = {level: [] for level in ("fit", "full")}
    for chunk in range(-(-n // PER_SKIN)):
        rng = np.random.default_rng([777, chunk, zlib.crc32(name.encode())])
        skin = make(rng)
        draw, surface, threshold = draw_of(skin.arm), skin.arm.links[0].surface, skin.arm.tactel_threshold
        estimator = Estimator(skin.arm, "full")
        for i in range(min(PER_SKIN, n - chunk * PER_SKIN)):
            while True:
                touches = draw(rng)
                if min((skin.feel(t[None]) >= threshold).sum() for t in touches) >= LEAST:
                    break
            readings = skin.read(skin.feel(touches), rng)
            for level, found in rows.items():
                start = time.thread_time()
                contacts = estimator.update(readings, 20_000_000 * i, level=level)
                spent = 1e6 * (time.thread_time() - start)
                found.append(
                    (
                        spent,
                        estimator.n_evaluated,
                        len(contacts) == len(touches),
                        errors(surface, touches, contacts),
                    )
                )
    return {level: summary(found) for level, found in rows.items()}


def errors(surface, touches, contacts):
    """Return (distance m, relative force error, normalised square, flags) of each touch; none of a wrong count."""
    if len(contacts) != len(touches):
        return []
    d = surface.distance(touches[:, :1], touches[:, 1:2], contacts.s, contacts.a)
    out = []
    for t, c in zip(*linear_sum_assignment(d), strict=True):
        off = np.array(
            [
                contacts.s[c] - touches[t, 0],
                float(surface.wrap(contacts.a[c] - touches[t, 1])),
                contacts.force[c] - touches[t, 2],
            ]
        )
        z = float(off @ np.linalg.solve(contacts.covariance[c], off)) / 3.0
        out.append((d[t, c], off[2] / touches[t, 2], z, int(contacts.quality[c]) & FLAGS))
    return out


def summary(found):
    """Return the figures of a family at a level."""
    e = np.array([row for case in found for row in case[3]] or [[np.nan] * 4])
    spent = np.array([case[0] for case in found])
    return {
        "right %": 100 * np.mean([case[2] for case in found]),
        "mm": 1e3 * np.sqrt(np.mean(e[:, 0] ** 2)),
        "force %": 100 * np.sqrt(np.mean(e[:, 1] ** 2)),
        "NEES": np.mean(e[:, 2]),
        "over 6 sd %": 100 * np.mean((e[:, 2] > 12.0) & (e[:, 3] == 0)),
        "flagged %": 100 * np.mean(e[:, 3] != 0),
        "evaluated": np.median([case[1] for case in found]),
        "us": np.median(spent),
        "p99 us": np.percentile(spent, 99),
    }


def serve():
    """Answer families named on standard input, as a worker of one tree."""
    for line in sys.stdin:
        name, n = json.loads(line)
        print(json.dumps(measure(name, n)), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=100, help="cases of each family")
    parser.add_argument("--beside", type=Path, help="another tree")
    parser.add_argument("--only", default="", help="part of the names of families")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve:
        return serve()
    trees = [Path(__file__).parents[2], *([args.beside] if args.beside else [])]
    workers = [
        subprocess.Popen(
            [sys.executable, __file__, "--serve"],
            env={**os.environ, "PYTHONPATH": str(tree.resolve())},
            cwd=tree,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for tree in trees
    ]
    names = [name for name in FAMILIES if args.only in name]
    shown = (
        list(summary([]).keys())
        if False
        else ["right %", "mm", "force %", "NEES", "over 6 sd %", "flagged %", "evaluated", "us", "p99 us"]
    )
    print("| family | level |", " | ".join(shown), "|\n|" + "---|" * (len(shown) + 2))
    for name in names:
        answers = []
        for worker in workers:
            worker.stdin.write(json.dumps([name, args.n]) + "\n")
            worker.stdin.flush()
            answers.append(json.loads(worker.stdout.readline()))
        for level in answers[0]:
            cells = [" / ".join(f"{a[level][key]:.3g}" for a in answers) for key in shown]
            print(f"| {name} | {level} |", " | ".join(cells), "|", flush=True)
    for worker in workers:
        worker.stdin.close()
        worker.wait()


if __name__ == "__main__":
    main()
