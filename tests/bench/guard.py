"""From a reading above its limit to GFC on the wire: 24 patches and a master on the bit-exact bus.

`python -m tests.bench.guard` prints times beside the bound of `skinbus plan` and draws the figure.
With `--faults N` it plays so many random faults instead, with `--quiet S` so many seconds of ordinary work.
"""

import argparse
import tempfile
from itertools import count
from pathlib import Path

import numpy as np

from skinbus.study.draw import new_figure, save
from tests.bench.guard_trials import ARMS, Trials, play_faults, play_quiet
from tests.guard.rig import MS

N_RANDOM, N_AT_ONCE, N_WORST = 200, 20, 40
SLICE = 1000
COLOURS = {"one, at any time": "tab:blue", "24 at once": "tab:green", "worst phase": "tab:red"}
FIGURE = Path("docs/figures/guard.svg")


def main(folder):
    """Print the times, and draw those to GFC."""
    figure, panels = new_figure(len(ARMS), width=3.4, height=2.8)
    print("ms from a press, median and worst: to GFC, the stop of the guard, and its request to a drive")
    for axes, name in zip(panels[0], ARMS, strict=True):
        for rate_hz in (50.0, ARMS[name][0]):
            trials = Trials(folder, name, rate_hz)
            kinds = {
                "one, at any time": [trials.random() for _ in range(N_RANDOM)],
                "24 at once": [trials.at_once() for _ in range(N_AT_ONCE)],
                "worst phase": [trials.worst() for _ in range(N_WORST)],
            }
            bound = trials.bound_ns / MS
            for kind, times in kinds.items():
                ms = np.array(times) / MS
                (gfc, stop, told), worst = np.median(ms, axis=0), ms.max(axis=0)
                assert worst[0] <= bound
                load = max(plan.cyclic_load for plan in trials.plans)
                print(
                    f"{name}, {rate_hz} Hz, load {load:.2f}, {len(ms)} {kind}: GFC {gfc:.3f}, {worst[0]:.3f};"
                )
                print(
                    f"  bound {bound:.3f}, {bound / worst[0]:.2f} of it; stop {stop:.3f}, {worst[1]:.3f};",
                    end=" ",
                )
                print(f"request {told:.2f}, {worst[2]:.2f}", flush=True)
                label = kind if rate_hz == 50.0 else None
                axes.ecdf(ms[:, 0], label=label, color=COLOURS[kind], ls="-" if label else "--")
        axes.axvline(bound, color="k", label="bound")
        axes.set(xlabel=f"{name}: ms to GFC", xlim=(0.0, 1.8), ylabel="share of presses")
    panels[0][0].legend(fontsize=7, loc="center right", bbox_to_anchor=(0.98, 0.25))
    save(figure, FIGURE)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--faults", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quiet", type=float)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if asked.faults:
            print("seed; faults and crossings so far; what was wrong")
            n_faults = n_crossings = 0
            for seed in count(asked.seed):
                if n_faults >= asked.faults:
                    break
                n, n_crossed, wrong = play_faults(Path(name), SLICE, seed)
                n_faults, n_crossings = n_faults + n, n_crossings + n_crossed
                print(
                    f"seed {seed}: {n_faults} faults, {n_crossings} crossings", *wrong, sep="\n  ", flush=True
                )
        elif asked.quiet:
            print("samples, largest, stop:", *play_quiet(Path(name), asked.quiet))
        else:
            main(Path(name))
