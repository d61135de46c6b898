"""How good and how fast the estimator is by family of touches: ``python -m tests.bench.estimator``.

A family is a skin and a draw of touches. Errors are those of the cases with the right count; "over 6 sd" is
the share of contacts further off than six standard deviations without a flag; time is that of the thread.
"""

import argparse
import re
import time
import zlib
from functools import partial
from itertools import islice

import numpy as np
from scipy.optimize import linear_sum_assignment

from skinbus.estimate import Estimator
from skinbus.model import Arm
from skinbus.model.patch import grid
from tests import skins
from tests.skins import reached

LEVELS = ("fit", "full")
FLAGS = 0b11111
"""Bits of a quality that are about the fit."""
PER_SKIN = 100
"""Cases after which another board is made and calibrated."""
DOUBTS = (("box", "crosstalk"), ("box", "half-space"), ("finger", "half-space"))
"""Skins whose physics the estimator does not have."""
COLUMNS = ("right %", "mm", "force %", "NEES", "over 6 sd %", "flagged %", "evaluated", "us", "p99 us")


def families():
    """Return skin and draw by the name of a family."""

    def apart(low, high, least, force, arm, rng):
        """Touches anywhere on the tactels of an arm, ``least`` m from each other."""
        surface, found = arm.links[0].surface, []
        ends = [(x.min(), x.max()) for x in (arm.tactel_s, arm.tactel_a)]
        for _ in range(rng.integers(low, high + 1)):
            while True:
                place = rng.uniform(*np.transpose(ends))
                if all(surface.distance(*place, *other[:2]) >= least for other in found):
                    break
            found.append([*place, rng.uniform(*force)])
        return np.array(found)

    def over_tactels(arm, rng):
        """One touch within half a pitch of a tactel inside a board."""
        p = arm.patches[rng.integers(arm.n_patches)]
        return np.array(
            [[p.s + rng.uniform(-0.01, 0.01), p.a + rng.uniform(-0.01, 0.01), rng.uniform(1.0, 10.0)]]
        )

    def each_board(arm, rng):
        """A touch in the middle of every board."""
        places = np.column_stack([arm.patch_s, arm.patch_a]) + rng.uniform(-0.01, 0.01, (arm.n_patches, 2))
        return np.column_stack([places, np.full(arm.n_patches, 5.0)])

    def finger(rng):
        return skins.shipped_skin(skins.cone_forearm(), rng.uniform(4e-3, 8e-3), rng)

    def whole(rings, n):
        arm = skins.cone_forearm(rings)
        return partial(skins.shipped_skin, Arm(f"{n} boards", arm.links, arm.patches[:n]), skins.FINGER)

    dense = partial(skins.cone_skin, Arm.single_patch(grid(8, 8, 0.0065)))

    def dense_radial(rng):
        skin = dense(rng)
        arm, law = skin.arm.with_law(skins.shipped_law()), skins.shipped_law()

        def feel(touches):
            d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, touches[:, :1], touches[:, 1:2])
            return sum(law.pressure(d[i], touches[i, 2]) for i in range(len(touches)))

        return skins.SkinModel(arm, feel, skin.read)

    five, dozen = partial(apart, 5, 5, 0.03, (5.0, 20.0)), partial(apart, 4, 6, 0.013, (2.0, 8.0))
    usual = [
        *(("pad", draw) for draw in ("one 2-20 N", "two", "three")),
        *(("forearm", draw) for draw in ("seam", "two on seam")),
        *(("finger", draw) for draw in ("one 5-20 N", "one 2 N", "two 15 mm")),
        *(("tip", "one 5-20 N"), ("finger, thumb", "one 2-20 N"), ("finger, tip", "one 2-20 N")),
        *((skin, "one 2-20 N") for skin in ("box", "box thumb", "box tip")),
        *((f"{skin} {doubt}", "one 2-20 N") for skin, doubt in DOUBTS),
        *(("box forearm", draw) for draw in ("seam", "two on seam")),
        *((skin, "two 15-25 mm") for skin in ("pad", "finger", "box")),
    ]
    return {f"{skin}: {draw}": (skins.SKINS[skin], skins.DRAWS[draw]) for skin, draw in usual} | {
        "64 tactels, cone: 4-6 at 13 mm": (dense, dozen),
        "64 tactels, radial: 4-6 at 13 mm": (dense_radial, dozen),
        "box forearm: finger over tactels": (finger, over_tactels),
        "box forearm: finger anywhere": (finger, partial(apart, 1, 1, 0.0, (1.0, 10.0))),
        **{f"{skin}: five anywhere": (skins.SKINS[skin], five) for skin in ("forearm", "box forearm")},
        "24 boards, each touched": (whole(3, 24), each_board),
        "126 boards, each touched": (whole(16, 126), each_board),
    }


def cases(name, skin_of, draw, n):
    """Yield arm, touches and readings of a family, board by board."""
    for chunk in range(-(-n // PER_SKIN)):
        rng = np.random.default_rng([777, chunk, zlib.crc32(name.encode())])
        skin = skin_of(rng)
        drawn = list(islice(reached(skin, draw, rng), min(PER_SKIN, n - chunk * PER_SKIN)))
        yield skin.arm, drawn, [skin.read(skin.feel(touches), rng) for touches in drawn]


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
    for name, (skin_of, draw) in families().items():
        if not re.search(args.only, name):
            continue
        found = {level: [] for level in LEVELS}
        for arm, drawn, readings in cases(name, skin_of, draw, args.n):
            estimator = Estimator(arm, "full")
            for k, (touches, pressures) in enumerate(zip(drawn, readings, strict=True)):
                for level in LEVELS:
                    start = time.thread_time_ns()
                    c = estimator.update(pressures, 20_000_000 * k, level=level)
                    us = 1e-3 * (time.thread_time_ns() - start)
                    rows = errors(arm.links[0].surface, touches, c.s, c.a, c.force, c.covariance, c.quality)
                    found[level].append((rows, len(c) == len(touches), estimator.n_evaluated, us))
        for level in LEVELS:
            print(
                f"| {name} | {level} |",
                " | ".join(f"{x:.3g}" for x in figures(found[level])),
                "|",
                flush=True,
            )


if __name__ == "__main__":
    main()
