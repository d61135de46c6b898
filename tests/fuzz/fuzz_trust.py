"""Boards that misbehave in every way at once under moving touches: how far from the truth is what is fresh.

An episode is 20 s of ten boards, each with a touch that moves on it. The first two boards
are healthy, the others draw one misbehaviour after the other; now and then another master sends SYNC. A
contact that is fresh and not IMPAIRED is a violation when it is further from every touch than six of its own
standard deviations, and what the touch moves in a cycle; a RECOVERING one says that nothing may touch there.
"""

from __future__ import annotations

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
from tests.master.misbehaving_rig import MS, TPDO_OF, Foreign, is_boot_up, still_waiting

RATE_HZ = 50.0
PERIOD_NS = round(1e9 / RATE_HZ)
EPISODE_NS = 20_000 * MS
BOOT_NS = 1000 * MS
N_BOARDS, N_HEALTHY = 10, 2
CENTRES_MM = tuple(28.0 + 60.0 * k for k in range(N_BOARDS))
N_SD = 6.0
FOREIGN_SHARE = 0.2
"""Of the episodes in which another master sends SYNC for a while."""
AFTER_FOREIGN_NS = 4000 * MS
"""For so long readings may be in doubt after another master."""

KINDS = (
    "late",
    "late by a period",
    "torn",
    "random",
    "missing",
    "lossy",
    "repeated",
    "frozen",
    "half frozen",
    "rails",
    "stuck",
    "reboot",
    "remap",
    "doubled",
    "late at times",
    "again in the next period",
    "old at times",
    "old in every second period",
)

ARM = """
[arm]
name = "ten boards"
rate_hz = 50.0

[[link]]
name = "plate"
surface = "plane"
length_mm = 596.0
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
            if is_boot_up(frame):
                self._waiting = still_waiting(self._waiting, node_id)
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
            "offset_ns": self.rng.uniform(-0.3, 0.3) * MS,
            "half": set(self.rng.permutation(4)[:2] + 1),
            "tactel": int(self.rng.integers(16)),
            "stuck": (-0x8000, 0x7FFF, None)[self.rng.integers(3)],
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
        elif kind == "late by a period":
            late_ns = PERIOD_NS + drawn["offset_ns"]
        elif kind == "lossy" and self.rng.random() < 0.05:
            return
        elif kind == "late at times" and self._is_late(now_ns):
            late_ns = PERIOD_NS
        elif kind == "again in the next period":
            self._send(now_ns + PERIOD_NS, frame)
        elif kind == "repeated":
            self._send(now_ns + drawn["second_ns"], frame)
        elif kind == "old at times":
            if number == 1:
                drawn["is_old"] = self.rng.random() < 0.3
            if drawn.get("is_old"):
                frame = frame._replace(data=self._held.get(frame.can_id, frame.data))
            self._held[frame.can_id] = frame.data
        elif kind == "old in every second period" and number == drawn["number"]:
            if now_ns // PERIOD_NS % 2:
                frame = frame._replace(data=self._held.get(frame.can_id, frame.data))
            self._held[frame.can_id] = frame.data
        elif kind == "missing" and number == drawn["number"]:
            return
        elif kind == "frozen" or (kind == "half frozen" and number in drawn["half"]):
            frame = frame._replace(data=self._held.setdefault(frame.can_id, frame.data))
        elif kind == "rails":
            frame = frame._replace(data=np.full(4, drawn["rail"], "<i2").tobytes())
        elif kind == "stuck" and number == 1 + drawn["tactel"] // 4:
            counts = np.frombuffer(frame.data, "<i2").copy()
            if drawn["stuck"] is None:
                drawn["stuck"] = counts[drawn["tactel"] % 4]
            counts[drawn["tactel"] % 4] = drawn["stuck"]
            frame = frame._replace(data=counts.tobytes())
        elif kind == "doubled":
            other = self.rng.normal(0.0, 8.0, 4).astype("<i2").tobytes()
            self._send(now_ns + drawn["second_ns"], frame._replace(data=other))
        self._send(now_ns + late_ns, frame)

    @staticmethod
    def _is_late(now_ns):
        """Whether answers to this SYNC are late, one in 25."""
        return now_ns // PERIOD_NS % 25 == 0

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
    """Draw what the boards that are not healthy do, one thing after the other with pauses between."""
    plans = {}
    for node_id in range(N_HEALTHY + 1, N_BOARDS + 1):
        plan, begin_ns = [], 2_500 * MS
        while begin_ns < EPISODE_NS:
            end_ns = begin_ns + rng.uniform(200, 4000) * MS
            plan.append((int(begin_ns), int(end_ns), str(rng.choice(KINDS))))
            begin_ns = end_ns + rng.uniform(200, 4000) * MS
        plans[node_id] = plan
    return plans


class Episode:
    """One run: what was published, against the truth."""

    def __init__(self, seed, seconds=EPISODE_NS / 1e9):
        rng = np.random.default_rng(seed)
        with tempfile.TemporaryDirectory() as folder:
            self.scene = load_scene(write_scene(Path(folder), rng))
            self.world = World(self.scene)
            self.master = Master(self.scene.arm, level="fit", on_cycle=self._check)
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
        self.wire.run(round(1e9 * seconds))

    def _is_foreign(self, t_ns):
        begin_ns, end_ns = self.foreign or (0, 0)
        return bool(self.foreign) and begin_ns - PERIOD_NS <= t_ns < end_ns + AFTER_FOREIGN_NS

    def _check(self, report):
        t_ns = report.t_ns
        if t_ns < BOOT_NS:
            return
        self.n["cycles"] += 1
        if not self._is_foreign(t_ns):
            self.n["healthy cycles"] += 1
            self.n["left out"] += round((t_ns - self._before_ns) / PERIOD_NS) - 1 if self._before_ns else 0
            self.n["healthy fresh"] += bool(report.fresh[:N_HEALTHY].all())
        judged = self.master.cycle.plausibility
        self.n["false alarms"] += bool(judged.n_faulty[:N_HEALTHY].any())
        self.n["withheld in error"] += bool(judged.is_withheld[:N_HEALTHY].any())
        sampled_ns = t_ns + PERIOD_NS // 2  # the SYNC has arrived by then
        self._before_ns = t_ns
        now, before = self.world.truth(sampled_ns), self.world.truth(sampled_ns - PERIOD_NS)
        contacts = report.contacts
        for c in range(len(contacts)):
            if contacts.quality[c] & Quality.IMPAIRED:
                self.n["impaired of others" if contacts.patch[c] >= N_HEALTHY else "impaired in error"] += 1
                continue
            p = int(contacts.patch[c])
            who = "others" if p >= N_HEALTHY else "the healthy"
            self.n[f"contacts of {who}"] += 1
            sd = np.sqrt(contacts.covariance[c, 2, 2])
            may_be_nothing = contacts.quality[c] & Quality.RECOVERING and contacts.force[c] <= N_SD * sd
            if not (may_be_nothing or self._is_true(contacts, c, now, before)):
                self.n[f"far of {who}"] += 1
                _, kind = self.boards.kind_of(t_ns, p + 1)
                self.violations.append((t_ns / MS, p, kind, Quality(int(contacts.quality[c]))))

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
