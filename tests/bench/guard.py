"""From a reading above its limit to GFC on the wire: 24 patches and a master on the bit-exact bus.

`python -m tests.bench.guard` prints times beside the bound of `skinbus plan` and draws the figure.
With `--faults N` it plays so many random faults instead, with `--quiet S` so many seconds of ordinary work.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from skinbus.objects.cia import NMT_COMMAND_ID
from skinbus.study.draw import new_figure, save
from tests.bench.guard_trials import ARMS, Trials, play_faults, play_quiet
from tests.guard.rig import MS

N_RANDOM, N_AT_ONCE, N_WORST = 200, 20, 40
SLICE = 1000
COLOURS = {
    "one, at any time": "tab:blue",
    "24 at once": "tab:green",
    "worst phase": "tab:red",
    "and a bit error": "tab:purple",
}
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
                "and a bit error": [trials.worst(NMT_COMMAND_ID) for _ in range(N_WORST)],
            }
            bound = trials.bound_ns / MS
            for kind, times in kinds.items():
                ms = np.array(times) / MS
                assert ms[:, 0].max() <= bound
                load = max(plan.cyclic_load for plan in trials.plans)
                print(f"{name}, {rate_hz} Hz, load {load:.2f}, bound {bound:.3f}, {kind}:", end=" ")
                print(np.median(ms, axis=0).round(2), ms.max(axis=0).round(2), flush=True)
                label = kind if rate_hz == 50.0 else None
                axes.ecdf(ms[:, 0], label=label, color=COLOURS[kind], ls="-" if label else "--")
        axes.axvline(bound, color="k", label="bound")
        axes.set(xlabel=f"{name}: ms to GFC", xlim=(0.0, 1.8), ylabel="share of presses")
    panels[0][0].legend(fontsize=6, loc="lower right", bbox_to_anchor=(0.62, 0.0))
    save(figure, FIGURE)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--faults", type=int)
    parser.add_argument("--seed", type=int, default=0, help="of the first 1000 trials")
    parser.add_argument("--quiet", type=float)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if asked.faults:
            print("seed, faults, crossings, wrong:")
            for seed in range(asked.seed, asked.seed + asked.faults // SLICE):
                print(seed, *play_faults(Path(name), SLICE, seed), flush=True)
        elif asked.quiet:
            print("samples, largest, stop:", *play_quiet(Path(name), asked.quiet))
        else:
            main(Path(name))
