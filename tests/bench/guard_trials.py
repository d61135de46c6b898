"""Presses, random faults and ordinary work on guarded arms, for `python -m tests.bench.guard`."""

from dataclasses import replace
from functools import partial

import numpy as np

from skinbus.can.core import NEVER
from skinbus.can.frame import LONG, Frame
from skinbus.config.system import load_arm
from skinbus.planning.guard import guard_bound
from skinbus.planning.plan import plans
from skinbus.sim import load_scene
from skinbus.sim.sampler import Sampler
from tests.bus.cores import Talker, destroy_one
from tests.guard.rig import ARMED, MASTER_LOST, MS
from tests.guard.test_fmea import SEEN
from tests.guard.whole import AREA, GUARD, KPA, LIVENESS_MS, NEWTONS, PLATE, Whole
from tests.planning.test_guard import FD, guarded
from tests.planning.test_schedule import longest

TWO = '[[bus]]\nname = "a"\n[[bus]]\nname = "b"\n'
ARMS = {
    "1 Mbit/s": (52.0, ()),
    "CAN FD": (70.0, FD.items()),
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
BOUND_NS = 1_500_000
"""From a crossing to GFC on the wire."""
QUIET_KPA = 40
"""Limit where a hand of 10 N rests on a disc of 20 mm, as the scene with drift has it: 32 kPa."""
LIVENESS, SILENT = 2, 5 + 2
"""ms: of trials with faults, and after how long a patch without it is a stop: the last may have waited for
the readings of a cycle."""
LATE = {
    "readings are lost on the wire": 0,
    "a node babbles": 0,
    "a tactel is out, and others of its patch are pressed": 0,
    "a tactel is out, and the master notices": 0,
    "the guard process is ended": 0,
    "what stops the robot does not answer": 0,
    "the master dies": 0,
    "GFC is lost": 1 + 2,
    "a tactel is said to be unhealthy": 1 + 2,
    "samples are old": 1 + 2,
    "the source of readings is frozen": 4 + 2,
}
"""ms by which a stop may be later where a patch goes on saying how it is; after others it may be silent."""
BOOTS = {
    "scribble",
    "somebody resets a patch",
    "somebody makes a patch PRE-OPERATIONAL",
    "somebody writes other limits",
    "somebody writes damaged limits",
    "the master dies",
}
"""Faults after which the master boots a patch: that takes 100 times as long."""
SHARE = 0.01
"""Of these among the others."""


def load_forearm(folder, changes=()):
    """Return the shipped forearm of 24 boards with a guard, and with other words."""
    return load_arm(guarded(folder, "forearm", GUARD.format(patches=[*range(1, 25)]), changes))


class Trials:
    """Presses on one arm at a SYNC rate; a time is how long after the press, ns."""

    def __init__(self, folder, name, rate_hz):
        arm = load_forearm(folder, [("rate_hz = 50.0", f"rate_hz = {rate_hz}"), *ARMS[name][1]])
        self.whole, self.rng = Whole(arm).until_guarding(100), np.random.default_rng(1)
        self.plans = plans(arm, {"kmeans": 0}, level="kmeans", response_ns=100_000)
        self.bound_ns = max(guard_bound(plan, arm.guard).frame_ns for plan in self.plans)

    def time(self, at_ns, tactels):
        """Press at a time; return when GFC ended, the guard stopped, and the request to the drive ended."""
        whole = self.whole
        whole.wires.run(at_ns)
        whole.press(tactels, 45.0)
        whole.run(40)
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

    def worst(self, hit_id=None):
        """Press just after a sample; one bit before the next a long frame begins, and a command waits.

        A bit error destroys a frame with the identifier ``hit_id``, if it is given.
        """
        whole, p = self.whole, int(self.rng.integers(24))
        scans = set(whole.scans[p][-100:])
        at_ns = max(t_ns for t_ns in scans if t_ns - MS in scans) + 2 * MS + 1
        is_fd = whole.arm.bus.data_bitrate is not None
        long = Frame(0x7DE, bytes(48), flags=LONG) if is_fd else longest(0x7DE, 8)
        whole.wire(p).attach(Talker([(at_ns + MS - 1001, long)]))
        whole.wire(p).attach(Talker([(at_ns + MS - 1, longest(0, 2))]))
        if hit_id is not None:
            destroy_one(whole.wire(p), hit_id)
        return self.time(at_ns, [16 * p + int(self.rng.integers(16))])


def scribble(whole, rng):
    """Somebody says anything to or as anybody, often about the guard."""
    for _ in range(rng.integers(1, 20)):
        word = rng.choice([0x2081, 0x2080, 0x1808, 0x1A08, rng.integers(0x1000, 0x7000)])
        request = bytes([rng.choice([0x22, 0x2F, 0x2B, 0x23, 0x21])]) + int(word).to_bytes(2, "little")
        to_patch = Frame(int(rng.choice([0x601, 0x602])), request + rng.bytes(5))
        whole.say(to_patch, Frame(int(rng.integers(2, 0x800)), rng.bytes(rng.integers(9))))


def play_faults(folder, n, seed=0):
    """Return how many faults and crossings n trials had, and what was wrong.

    A trial is up to two faults and a press, each up to 3 ms after the one before. Then all is repaired, trips
    are acknowledged, and the next begins soon after the guard says that it guards.
    """
    text = PLATE.replace(f"liveness_ms = {LIVENESS_MS}", f"liveness_ms = {LIVENESS}")
    (folder / "plate.toml").write_text(text.replace("[arm]", "[arm]\nrate_hz = 10"))
    arm, rng = load_arm(folder / "plate.toml"), np.random.default_rng(seed)
    causes = [name for name in SEEN if "contact" not in name] + ["scribble"]
    shares = np.array([SHARE if name in BOOTS else 1.0 for name in causes])
    n_faults, n_crossings, wrong, whole = 0, 0, [], Whole(arm, seed)
    for k in range(n):
        try:
            whole.repair()
            whole.until_guarding(rng.uniform(0.0, 3.0))
        except AssertionError:  # somebody has changed for good what a patch sends
            whole = Whole(arm, k).until_guarding()
        names = rng.choice(causes, rng.integers(3), p=shares / shares.sum()).tolist()
        for name in rng.permutation([*names, "press"]).tolist():
            whole.run(rng.uniform(0.0, 3.0))
            if name == "scribble":
                scribble(whole, rng)
            else:
                (partial(press_any, rng=rng) if name == "press" else SEEN[name][0])(whole)
        whole.run(BOUND_NS / MS)
        late = max((LATE.get(name, SILENT) for name in names), default=0)
        if any(map(boots, whole.frames)) or (late and "a node babbles" in names):
            late = SILENT
        extra_ns = MASTER_LOST if {"the master dies"} < {*names} and late == SILENT else late * MS
        if whole.crossed_ns and not whole.stops_ns():
            whole.run(extra_ns / MS)
        stopped_ns = min(whole.stops_ns(), default=NEVER)
        n_faults, n_crossings = n_faults + len(names), n_crossings + len(whole.crossed_ns)
        for p, at_ns in whole.crossed_ns.items():
            if stopped_ns > at_ns + BOUND_NS + extra_ns:
                wrong.append(f"trial {k}, {names}, board {p + 1}: {(stopped_ns - at_ns) / MS:.2f} ms")
        if stopped_ns < NEVER and not (late or names or whole.crossed_ns):
            wrong.append(f"trial {k}: {whole.guard.reason}")
    return n_faults, n_crossings, wrong


def press_any(whole, rng):
    """Press on a tactel or a whole board, more or less than it may be."""
    if rng.random() < 0.5:
        whole.press(rng.integers(6, 32, size=1), KPA + rng.choice([-0.7, 0.7, 15.0]))
    else:  # areas by which forces are summed are known to a few percent
        share = rng.choice([0.9, 1.01, 1.2])
        whole.press(16 * rng.integers(2) + np.arange(16), share * 1e-3 * NEWTONS / 16 / AREA)


def boots(frame):
    """Whether somebody starts or ends a patch, or it says that it has begun."""
    return frame.can_id == 0 or (0x700 < frame.can_id < 0x77F and frame.data == b"\0")


class Scene(Whole):
    """An arm on which a scene takes place, sampled each millisecond."""

    def __init__(self, arm, scene):
        self.sampled_ns, self.nearest, self.sampler = 0, 0.0, Sampler(scene)
        super().__init__(arm)

    def newest(self, p, now_ns):
        if now_ns >= self.sampled_ns + MS:
            self.sampled_ns = now_ns
            self.sampler.sample(1e-9 * now_ns)
            self.counts = self.sampler.counts
            self.nearest = max(self.nearest, 1e-3 * self.sampler.pressures.max() / QUIET_KPA)
        return super().newest(p, now_ns)


def play_quiet(folder, seconds):
    """Return the samples of a scene that drifts, the largest as a share of its limit, and why it stopped."""
    arm = load_forearm(folder, [(f"pressure_kpa = {KPA}", f"pressure_kpa = {QUIET_KPA}")])
    scene = replace(
        load_scene("cold-start-drift", arm=arm), seed=2
    )  # soon guards: a tactel of seed 0 does not
    whole = Scene(arm, scene).until_guarding()
    n = -sum(map(len, whole.scans))
    whole.run(1000 * seconds)
    return n + sum(map(len, whole.scans)), whole.nearest, whole.guard.reason
