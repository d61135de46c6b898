"""From a reading above its limit to GFC on the wire: 24 patches and a master on the bit-exact bus.

`python -m tests.bench.guard` prints times beside the bound of `skinbus plan` and draws the figure.
With `--faults N` it plays so many random faults instead, with `--quiet S` so many seconds of ordinary work.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from skinbus.can.core import NEVER
from skinbus.can.frame import LONG, Frame
from skinbus.planning.guard import guard_bound
from skinbus.planning.plan import plans
from skinbus.study.draw import new_figure, save
from tests.bench.guard_faults import load_forearm, play_faults, play_quiet
from tests.guard.rig import ARMED, MS
from tests.guard.whole import Whole
from tests.planning.test_schedule import Talker, longest

N_RANDOM, N_AT_ONCE, N_WORST = 200, 20, 40
COLOURS = {"one, at any time": "tab:blue", "24 at once": "tab:green", "worst phase": "tab:red"}
FIGURE = Path("docs/figures/guard.svg")
TWO = '[[bus]]\nname = "a"\n[[bus]]\nname = "b"\n'
ARMS = {
    "1 Mbit/s": (52.0, ()),
    "CAN FD": (
        70.0,
        (
            ("[arm]\n", "[arm]\ncanfd = true\ndata_bitrate = 2_000_000\n"),
            ("first_node_id", 'eds = "skin-patch-fd"\nfirst_node_id'),
        ),
    ),
    "two buses": (
        70.0,
        (
            ("[[link]]", TWO + "[[link]]"),
            ("first_node_id", 'bus = "a"\nfirst_node_id'),
            ('bus = "a"\nfirst_node_id = 17', 'bus = "b"\nfirst_node_id = 17'),
            ("bitrate = 1_000_000\n", ""),
        ),
    ),
}
"""The fastest SYNC beside 50 Hz, nearly what an arm file may say, and changes of the shipped forearm."""


class Trials:
    """Presses on one arm at a SYNC rate; a time is how long after the press, ns."""

    def __init__(self, folder, name, rate_hz):
        arm = load_forearm(folder, [("rate_hz = 50.0", f"rate_hz = {rate_hz}"), *ARMS[name][1]])
        self.whole, self.rng = Whole(arm).until_guarding(700), np.random.default_rng(1)
        self.plans = plans(arm, {"kmeans": 0}, level="kmeans", response_ns=100_000)
        self.bound_ns = max(guard_bound(plan, arm.guard).frame_ns for plan in self.plans)

    def time(self, at_ns, tactels):
        """Press at a time; return when GFC ended, the guard stopped, and the request to the drive ended."""
        whole = self.whole
        whole.wires.run(at_ns)
        whole.press(tactels, 45.0)
        whole.run(20)
        found = [
            min(times, default=NEVER) - at_ns for times in (whole.gfc_ns(), whole.stops_ns(), whole.told_ns())
        ]
        whole.again()
        while any(whole.device(p).get(0x2080, 1) != ARMED for p in range(24)):
            whole.run(10)
        whole.run(self.rng.uniform(0.0, 20.0))
        return found

    def random(self):
        """Press one tactel at any time."""
        return self.time(self.whole.now_ns, self.rng.integers(384, size=1))

    def at_once(self):
        """Press one tactel of each board."""
        return self.time(self.whole.now_ns, np.arange(0, 384, 16) + self.rng.integers(16, size=24))

    def worst(self):
        """Press just after a sample; one bit before the next a long frame begins, and a command waits."""
        whole, p = self.whole, int(self.rng.integers(24))
        scans = set(whole.scans[p][-100:])
        at_ns = max(t_ns for t_ns in scans if t_ns - MS in scans) + 2 * MS + 1
        is_fd = whole.arm.bus.data_bitrate is not None
        long = Frame(0x7DE, bytes(48), flags=LONG) if is_fd else longest(0x7DE, 8)
        whole.wire(p).attach(Talker(at_ns + MS - 1001, [long]))
        whole.wire(p).attach(Talker(at_ns + MS - 1, [longest(0, 2)]))
        return self.time(at_ns, [16 * p + int(self.rng.integers(16))])


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
    panels[0][0].legend(fontsize=7, loc="upper left")
    save(figure, FIGURE)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--faults", type=int)
    parser.add_argument("--quiet", type=float)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if asked.faults:
            print("faults, crossings, wrong:", *play_faults(Path(name), asked.faults))
        elif asked.quiet:
            print("samples, largest, stop:", *play_quiet(Path(name), asked.quiet))
        else:
            main(Path(name))
