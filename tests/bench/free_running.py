"""What 126 patches cost that send on a change, and how soon a touch is published.

They are on six buses, beside the same patches that answer 50 SYNCs a second. Wires and boards are simulated;
the master is real; latencies are those without its compute time: `python -m tests.bench.free_running`.
"""

import tempfile
import time
from pathlib import Path

import numpy as np

from skinbus.can.virtual_buses import VirtualBuses
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.master import Master
from skinbus.sim import World, load_scene
from tests.files import put
from tests.master.test_free_running import by_events
from tests.sim.truth import truth_of

N, N_BUSES, N_TOUCHES = 126, 6, 100
FORCE_N, RAMP_S, TOUCH_S = 3.0, 0.03, 0.3
DELTA, EVENT_MS = 12, 5000
"""Change that is sent, 92 Pa, a tenth of the touch threshold; after so long a patch sends all again."""


def write_arm(folder, values, rate_hz):
    """Planes with two rows of boards, each on a bus of its own."""
    text = f'[arm]\nname = "planes"\nrate_hz = {rate_hz}\n'
    for bus in range(N_BUSES):
        text += f'[[bus]]\nname = "b{bus}"\n'
    for bus in range(N_BUSES):
        text += f'[[link]]\nname = "l{bus}"\nsurface = "plane"\nlength_mm = 570.0\nwidth_mm = 110.0\n'
    for p in range(N):
        bus, k = divmod(p, N // N_BUSES)
        s_mm, a_mm = 26.0 + 51.0 * (k // 2), 51.0 * (k % 2) - 25.5
        text += f'[[patch]]\nnode_id = {p + 1}\nlink = "l{bus}"\nbus = "b{bus}"\n'
        text += f"s_mm = {s_mm}\na_mm = {a_mm}\nset = {values}\n"
    put(folder, "planes.toml", text)


def write_scene(folder, starts_s):
    """Touches at random places, one after the other."""
    rng = np.random.default_rng(1)
    text = '[scene]\ntitle = "touches"\narm = "planes.toml"\nduration_s = 1000.0\n'
    for start in starts_s:
        link, s_mm, a_mm = rng.integers(N_BUSES), rng.uniform(20.0, 490.0), rng.uniform(-45.0, 45.0)
        ends = [
            [start, 0.0],
            [start + RAMP_S, FORCE_N],
            [start + TOUCH_S, FORCE_N],
            [start + TOUCH_S + RAMP_S, 0.0],
        ]
        text += f'[[touch]]\nlink = "l{link}"\ns_mm = {s_mm}\na_mm = {a_mm}\nforce_n = {ends}\n'
    put(folder, "scene.toml", text)


class Timed:
    """The time that a master computes."""

    def __init__(self, master):
        self.spent_ns = 0
        for name in ("step", "take"):
            setattr(master, name, self.timed(getattr(master, name)))

    def timed(self, call):
        def run(*given):
            begin_ns = time.thread_time_ns()
            try:
                return call(*given)
            finally:
                self.spent_ns += time.thread_time_ns() - begin_ns

        return run


def play(folder, seconds, starts_s=()):
    """Return frames and master's CPU a second while nothing touches, and the latencies of touches, ms."""
    write_scene(folder, starts_s)
    scene = load_scene(folder / "scene.toml")
    world, published_ns, begun = World(scene), [], []
    world.on_sample = lambda now_ns, t_s: begun.append(now_ns - round(1e9 * t_s))
    wires = VirtualBuses([1_000_000] * N_BUSES)
    wires.attach(world)

    def note(report):
        if len(report.contacts):
            published_ns.append(report.t_ns + report.latency_ns)

    master = Master(scene.arm, on_cycle=note)
    timed = Timed(master)
    wires.attach(master)
    frames = []
    for wire in wires.wires:
        wire.tap(frames.append)
    wires.run(4_000_000_000)
    assert master.table.is_running.all()
    n, cpu_ns = len(frames), timed.spent_ns
    wires.run(4_000_000_000 + round(1e9 * seconds))
    idle = (len(frames) - n) / seconds, 1e-9 * (timed.spent_ns - cpu_ns) / seconds
    latencies, patch, truth = [], scene.arm.patches[0].patch, truth_of(scene)
    levels_pa = patch.threshold, float(EVIDENCE**0.5 * np.max(patch.noise))
    for start in starts_s:
        times = start + np.arange(0.0, RAMP_S, 1e-4)
        most = np.array([truth(t).max() for t in times])
        if most[-1] < levels_pa[1]:  # in a gap between boards
            continue
        crossing_s = times[[(most >= level).argmax() for level in levels_pa]]
        del published_ns[:]
        wires.run(begun[-1] + round(1e9 * (start + TOUCH_S)))
        sent_ns = next(iter(published_ns), np.inf)
        latencies.append(1e-6 * (sent_ns - begun[-1]) - 1e3 * crossing_s)
        wires.run(begun[-1] + round(1e9 * (start + TOUCH_S + 0.1)))
    return *idle, np.array(latencies)


def main():
    """Print the figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_arm(folder, "{}", 50.0)
        frames, cpu, _ = play(folder, 1.0)
        write_arm(folder, by_events(EVENT_MS, delta=DELTA), 5.0)
        starts_s = 10.0 + 0.5 * np.arange(N_TOUCHES) + np.random.default_rng(0).uniform(0.0, 0.05, N_TOUCHES)
        free_frames, free_cpu, latencies = play(folder, 4.0, starts_s.tolist())
    title = f"{N} patches on {N_BUSES} buses, nothing touches:"
    print(title, "50 SYNCs a second", f"{frames:.0f} frames/s, {cpu:.3f} of a core in the master;")
    print(f"on change {free_frames:.0f} ({free_frames / frames:.1%}), {free_cpu:.3f} ({free_cpu / cpu:.1%})")
    print(f"{len(latencies)} touches, to the contact, without computing:")
    for begin, ms in zip(("the threshold", "what is a contact on one tactel"), latencies.T, strict=True):
        median, worst, soon = np.median(ms), ms.max(), np.mean(ms <= 5.0)
        print(f"from {begin} on: median {median:.1f} ms, worst {worst:.1f} ms, {soon:.1%} within 5 ms")


if __name__ == "__main__":
    main()
