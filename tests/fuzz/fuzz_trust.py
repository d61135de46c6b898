"""Boards that misbehave in every way at once under moving touches: how far from the truth is what is fresh.

``python -m tests.fuzz.fuzz_trust`` runs 10^5 cycles; ``--cycles`` and ``--seed`` choose otherwise. An episode
is 20 s of three boards, each with a touch that moves on it. The first board is healthy, the others draw one
misbehaviour after the other; now and then another master sends SYNC. A contact that is fresh and not
IMPAIRED is a violation when it is further from every touch than six of its own standard deviations, and
what the touch moves in a cycle.
"""

from __future__ import annotations

import argparse
import heapq
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from skinbus.can.core import Core, Step
from skinbus.can.virtual_bus import VirtualBus
from skinbus.estimate import Quality
from skinbus.master import Master
from skinbus.objects import cia
from skinbus.sim import World, load_scene
from tests.master.misbehaving import Tool, swapped_mappings
from tests.master.misbehaving_rig import MS, TPDO_OF, Foreign

RATE_HZ = 50.0
PERIOD_NS = round(1e9 / RATE_HZ)
EPISODE_NS = 20_000 * MS
BOOT_NS = 1000 * MS
CENTRES_MM = (28.0, 88.0, 148.0)
N_SD = 6.0
FOREIGN_SHARE = 0.2
"""Of the episodes in which another master sends SYNC for a while."""
AFTER_FOREIGN_NS = 15_000 * MS
"""For so long readings may be in doubt after another master."""

KINDS = ("late", "torn", "random", "missing", "frozen", "rails", "reboot", "remap", "doubled")

ARM = """
[arm]
name = "three boards"
rate_hz = 50.0

[[link]]
name = "plate"
surface = "plane"
length_mm = 176.0
width_mm = 60.0
"""


def point(t_s, s_mm, offset):
    """A point of a path, as a scene file has it."""
    return f"[{t_s:.3f}, {s_mm + offset[0]:.2f}, {offset[1]:.2f}]"


def write_scene(folder: Path, rng: np.random.Generator) -> Path:
    """Write the arm and a scene of moving touches; return the file of the scene."""
    arm = ARM
    for node_id, s_mm in enumerate(CENTRES_MM, 1):
        arm += f'\n[[patch]]\nnode_id = {node_id}\nlink = "plate"\ns_mm = {s_mm}\n'
    (folder / "arm.toml").write_text(arm)
    text = '[scene]\ntitle = "touches that move"\narm = "arm.toml"\nduration_s = 30.0\n\n[effect.noise]\n'
    for s_mm in CENTRES_MM:
        begin = 2.0
        while begin < EPISODE_NS / 1e9:
            end = begin + rng.uniform(2.0, 4.0)
            here, there = rng.uniform(-8.0, 8.0, (2, 2))
            text += f"""
[[touch]]
link = "plate"
path = [{point(begin, s_mm, here)}, {point(end, s_mm, there)}]
shape = "disc"
diameter_mm = 10.0
force_n = {rng.uniform(3.0, 10.0):.2f}
start_s = {begin:.3f}
end_s = {end:.3f}
"""
            begin = end + rng.uniform(0.6, 1.2)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


class Boards(Core):
    """A world whose boards misbehave by plan: (begin_ns, end_ns, kind) by node-ID."""

    def __init__(self, world, plans, rng):
        self.world, self.plans, self.rng = world, plans, rng
        self.wire = None
        self._begun = set()
        self._held, self._of = {}, {}
        self._waiting = []
        self._n = 0

    @property
    def cob_ids(self):
        return self.world.cob_ids

    def kind_of(self, now_ns, node_id):
        """What a board does now, and since when; None: what it should."""
        for begin_ns, end_ns, kind in self.plans.get(node_id, ()):
            if begin_ns <= now_ns < end_ns:
                return begin_ns, kind
        return None, None

    def step(self, now_ns, frames):
        for node_id in self.plans:
            begin_ns, kind = self.kind_of(now_ns, node_id)
            if kind and (node_id, begin_ns) not in self._begun:
                self._begun.add((node_id, begin_ns))
                self._begin(node_id, begin_ns, kind)
        step = self.world.step(now_ns, frames)
        out = []
        for frame in step.frames:
            number, node_id = TPDO_OF.get(frame.can_id & ~0x7F), frame.can_id & 0x7F
            if number is None or node_id not in self.plans:
                out.append(frame)
                continue
            self._pass_on(now_ns, frame, number, node_id)
        while self._waiting and self._waiting[0][0] <= now_ns:
            out.append(heapq.heappop(self._waiting)[2])
        wake_ns = min([step.wake_ns, *(w[0] for w in self._waiting[:1])])
        return Step(out, step.events, wake_ns)

    def _begin(self, node_id, begin_ns, kind):
        device = self.world.devices[node_id - 1]
        self._of[node_id] = {
            "late_ns": self.rng.uniform(1.0, 3.2) * PERIOD_NS,
            "number": int(self.rng.integers(1, 5)),
            "rail": int(self.rng.choice([-0x8000, 0x7FFF])),
            "second_ns": self.rng.uniform(0.2, 8.0) * MS,
        }
        self._held = {key: data for key, data in self._held.items() if key & 0x7F != node_id}
        if kind == "reboot":
            device.command(cia.NmtCommand.RESET_NODE)
        elif kind == "remap":
            self.wire.attach(Remapper(device))

    def _pass_on(self, now_ns, frame, number, node_id):
        _, kind = self.kind_of(now_ns, node_id)
        drawn = self._of.get(node_id, {})
        late_ns = 0.0
        if kind == "late" or (kind == "torn" and number > 2):
            late_ns = drawn["late_ns"]
        elif kind == "random":
            late_ns = self.rng.uniform(0.0, 2.0) * PERIOD_NS
        elif kind == "missing" and number == drawn["number"]:
            return
        elif kind == "frozen":
            frame = frame._replace(data=self._held.setdefault(frame.can_id, frame.data))
        elif kind == "rails":
            frame = frame._replace(data=np.full(4, drawn["rail"], "<i2").tobytes())
        elif kind == "doubled":
            other = self.rng.normal(0.0, 8.0, 4).astype("<i2").tobytes()
            self._send(now_ns + drawn["second_ns"], frame._replace(data=other))
        self._send(now_ns + late_ns, frame)

    def _send(self, t_ns, frame):
        self._n += 1
        heapq.heappush(self._waiting, (round(t_ns), self._n, frame))


class Remapper(Tool):
    """Another tool: swaps two mappings, stores that and resets the board."""

    def __init__(self, device):
        super().__init__(device.node_id, swapped_mappings(device))
        self.device = device
        self.is_reset = False

    def step(self, now_ns, frames):
        step = super().step(now_ns, frames)
        if self.is_done and not self.is_reset:
            self.is_reset = True
            self.device.command(cia.NmtCommand.RESET_NODE)
        return step


def plans_of(rng):
    """Draw what the boards from the second on do, one thing after the other with pauses between."""
    plans = {}
    for node_id in range(2, len(CENTRES_MM) + 1):
        plan, begin_ns = [], 2_500 * MS
        while begin_ns < EPISODE_NS:
            end_ns = begin_ns + rng.uniform(200, 4000) * MS
            plan.append((int(begin_ns), int(end_ns), str(rng.choice(KINDS))))
            begin_ns = end_ns + rng.uniform(200, 4000) * MS
        plans[node_id] = plan
    return plans


class Episode:
    """One run: what was published, against the truth."""

    def __init__(self, seed, level="fit"):
        rng = np.random.default_rng(seed)
        with tempfile.TemporaryDirectory() as folder:
            self.scene = load_scene(write_scene(Path(folder), rng))
            self.world = World(self.scene)
            self.master = Master(self.scene.arm, level=level, on_cycle=self._check)
        self.boards = Boards(self.world, plans_of(rng), rng)
        self.foreign = None
        self._before_ns = 0
        self.n = Counter()
        self.violations = []
        self.wire = VirtualBus(self.scene.arm.bus.bitrate)
        self.wire.attach(self.boards)
        self.boards.wire = self.wire
        self.wire.attach(self.master)
        if rng.random() < FOREIGN_SHARE:
            begin_ns = int(rng.uniform(3000, 8000)) * MS
            self.foreign = begin_ns, begin_ns + int(rng.uniform(200, 2000)) * MS
            self.wire.attach(Foreign(70.0, *self.foreign))
        self.wire.run(EPISODE_NS)

    def _is_foreign(self, t_ns):
        return self.foreign and self.foreign[0] <= t_ns < self.foreign[1] + AFTER_FOREIGN_NS

    def _check(self, report):
        t_ns = report.t_ns
        if t_ns < BOOT_NS:
            return
        self.n["cycles"] += 1
        if not self._is_foreign(t_ns):
            self.n["healthy cycles"] += 1
            self.n["left out"] += round((t_ns - self._before_ns) / PERIOD_NS) - 1 if self._before_ns else 0
            self.n["healthy fresh"] += bool(report.fresh[0])
        sampled_ns = t_ns + PERIOD_NS // 2  # the SYNC has arrived by then
        self._before_ns = t_ns
        now, before = self.world.truth(sampled_ns), self.world.truth(sampled_ns - PERIOD_NS)
        contacts = report.contacts
        for c in range(len(contacts)):
            if contacts.quality[c] & Quality.IMPAIRED:
                self.n["impaired"] += 1
                continue
            p = int(contacts.patch[c])
            self.n["contacts of others" if p else "contacts of the healthy"] += 1
            if not self._is_true(contacts, c, now, before):
                self.n["far of others" if p else "far of the healthy"] += 1
                kind_ns, kind = self.boards.kind_of(t_ns, p + 1)
                since = (t_ns - kind_ns) / MS if kind else 0.0
                self.violations.append((t_ns / MS, p, kind or "none", since))

    @staticmethod
    def _is_true(contacts, c, now, before):
        cov = contacts.covariance[c]
        place_sd = np.sqrt(np.linalg.eigvalsh(cov[:2, :2])[-1])
        for k, touch in enumerate(now.touch):
            (old,) = np.nonzero(before.touch == touch)
            moved = np.hypot(now.s[k] - before.s[old[0]], now.a[k] - before.a[old[0]]) if len(old) else 0.0
            grown = abs(now.force[k] - (before.force[old[0]] if len(old) else 0.0))
            away = np.hypot(contacts.s[c] - now.s[k], contacts.a[c] - now.a[k])
            off = abs(contacts.force[c] - now.force[k])
            if away <= N_SD * place_sd + moved and off <= N_SD * np.sqrt(cov[2, 2]) + grown:
                return True
        return False


def fuzz(n_cycles, seed):
    """Run episodes until so many cycles are over; return the counts, and the violations by kind."""
    n, violations = Counter(), []
    while n["cycles"] < n_cycles:
        episode = Episode(seed)
        n.update(episode.n)
        violations += [(seed, *violation) for violation in episode.violations]
        seed += 1
    return n, violations


def main():
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    n, violations = fuzz(arguments.cycles, arguments.seed)
    print(dict(n))
    periods = n["healthy cycles"] + n["left out"]
    print(
        f"healthy board: fresh in {n['healthy fresh'] / n['healthy cycles']:.5f} of the cycles, "
        f"{n['healthy fresh'] / periods:.5f} of the periods, gaps included"
    )
    print(len(violations), "violations", Counter(violation[3] for violation in violations))
    for violation in violations[:40]:
        print(violation)


if __name__ == "__main__":
    main()
