"""How good and how fast the estimator is by family of touches: ``python -m tests.bench.estimator``.

A family is a skin and a draw of touches. Errors are those of the cases with the right count; "over 6 sd" is
the share of contacts further off than six standard deviations without a flag; time is that of the thread.
"""

import argparse
import re
import time
import zlib
from itertools import islice

import numpy as np
from scipy.optimize import linear_sum_assignment

from skinbus.estimate import Estimator
from tests.skins import DRAWS, SKINS, reached

SEED = 777
LEVELS = ("fit", "full")
FLAGS = 0b11111
"""Bits of a quality that are about the fit."""
PER_SKIN = 100
"""Cases after which another board is made and calibrated."""
FAMILIES = [
    *(("pad", draw) for draw in ("one 2-20 N", "two", "three", "two 15-25 mm")),
    *(("forearm", draw) for draw in ("seam", "two on seam")),
    *(("finger", draw) for draw in ("one 5-20 N", "one 2 N", "two 15 mm", "two 15-25 mm")),
    *(("tip", "one 5-20 N"), ("finger, thumb", "one 2-20 N"), ("finger, tip", "one 2-20 N")),
    *((skin, "one 2-20 N") for skin in ("box", "box thumb", "box tip")),
    *(("box", "two 15-25 mm"), ("box forearm", "seam"), ("box forearm", "two on seam")),
    # physics that the estimator does not have
    *((skin, "one 2-20 N") for skin in ("box crosstalk", "box half-space", "finger half-space")),
]
COLUMNS = ("right %", "mm", "force %", "NEES", "over 6 sd %", "flagged %", "evaluated", "us", "p99 us")


def measure(skin_name, draw, n, seed, chunk=0, levels=LEVELS, **budget):
    """Return by level what n cases on a board gave: errors of touches, right count, work, time (us)."""
    rng = np.random.default_rng([seed, chunk, zlib.crc32(f"{skin_name} {draw}".encode())])
    skin, found = SKINS[skin_name](rng), {level: [] for level in levels}
    estimator, surface = Estimator(skin.arm, "full", **budget), skin.arm.links[0].surface
    for k, touches in enumerate(islice(reached(skin, DRAWS[draw], rng), n), 1):
        pressures = skin.read(skin.feel(touches), rng)
        for level, cases in found.items():
            start = time.thread_time_ns()
            c = estimator.update(pressures, 20_000_000 * k, level=level)
            us = 1e-3 * (time.thread_time_ns() - start)
            rows = errors(surface, touches, c.s, c.a, c.force, c.covariance, c.quality)
            cases.append((rows, len(c) == len(touches), estimator.n_evaluated, us))
    return found


def errors(surface, touches, s, a, force, covariance, quality):
    """Return (m, relative force error, normalised square, flags) of each touch; none of a wrong count."""
    if len(s) != len(touches):
        return []
    d = surface.distance(touches[:, :1], touches[:, 1:2], s, a)
    rows = []
    for t, c in zip(*linear_sum_assignment(d), strict=True):
        off = np.array([s[c], a[c], force[c]]) - touches[t]
        off[1] = surface.wrap(off[1])
        square = off @ np.linalg.solve(covariance[c], off) / 3.0
        rows.append((d[t, c], off[2] / touches[t, 2], square, int(quality[c]) & FLAGS))
    return rows


def figures(found):
    """Return the row of a family at a level from (errors, right, evaluated, us) of its cases."""
    rows, right, evaluated, us = zip(*found, strict=True)
    e = np.array([row for case in rows for row in case] or [[np.nan] * 4])
    return (
        100.0 * np.mean(right),
        1e3 * np.sqrt(np.mean(e[:, 0] ** 2)),
        100.0 * np.sqrt(np.mean(e[:, 1] ** 2)),
        np.mean(e[:, 2]),
        100.0 * np.mean((e[:, 2] > 12.0) & (e[:, 3] == 0)),
        100.0 * np.mean(e[:, 3] != 0),
        np.median(evaluated),
        np.median(us),
        np.percentile(us, 99),
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=100, help="cases of each family")
    parser.add_argument("--only", default="", help="regular expression of the families")
    args = parser.parse_args()
    print("| family | level |", " | ".join(COLUMNS), "|\n|" + "---|" * (len(COLUMNS) + 2))
    for skin, draw in FAMILIES:
        if not re.search(args.only, f"{skin}: {draw}"):
            continue
        chunks = [
            measure(skin, draw, min(PER_SKIN, args.n - begin), SEED, chunk)
            for chunk, begin in enumerate(range(0, args.n, PER_SKIN))
        ]
        for level in LEVELS:
            row = figures([case for chunk in chunks for case in chunk[level]])
            print(f"| {skin}: {draw} | {level} |", " | ".join(f"{x:.3g}" for x in row), "|", flush=True)


if __name__ == "__main__":
    main()
