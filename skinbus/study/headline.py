"""What accuracy costs on one arm, at a glance: latency against the error in 95 of 100 cycles.

Fingers press anywhere on the boards of an arm, alone or two near each other: a skin that is calibrated and
pressed straight, or the law that ships and inclined pushes. The error of a cycle is that of its worst touch;
one that is missed, merged with another, or beside a contact where no touch is, counts as a pitch at least.
The latency of a point is from touch to contact: half a period until the next SYNC, readings and contacts on
the wire in the worst case, and 99 % of the computing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from skinbus.estimate import LEVELS, Estimator, learn_radial_law
from skinbus.model import Arm, Law, Surface, Transducer
from skinbus.planning.plan import NARROW_EDS, plans
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads
from skinbus.study.crb import bound, ideal_distances
from skinbus.study.score import GATE

Floats = npt.NDArray[np.float64]

ARMS: Final = ("pad", "forearm", "arm")
"""Of those that ship: one board, a ring of boards on one bus, a whole arm."""
TRIALS: Final = 400
"""Of each point: the 95th percentile then rests on 20 cycles."""
SEED: Final = 16
FINGERS: Final = (0.010, 0.012, 0.015)
"""Diameters of fingertips, m."""
PRESSES: Final = 300
PRESS_FINGER: Final = 1
"""Presses of a calibration are by the middle one of the fingers."""
FORCES: Final = (2.0, 12.0)
"""N, evenly spread in the logarithm."""
APART: Final = (0.015, 0.025)
"""Distance of two fingers that come together, m."""
NOISE: Final = 200.0
"""Pa, as in the EDS files."""
GAIN_SPREAD: Final = 0.03
INCLINATION: Final = 0.3
"""Tangential force per normal force of an inclined push: what a hand that leans on an arm has."""
IDEAL_DRAWS: Final = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """What is true of the skin, and how it is pressed."""

    name: str
    calibrated: bool
    inclination: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One level with readings of so many bits, under one condition."""

    arm: str
    condition: str
    fingers: int
    level: str
    bits: int
    p50_mm: float
    p95_mm: float
    wrong_count_pct: float
    """Of the cycles: not as many contacts as touches."""
    bound_p95_mm: float
    """Of ideal estimates of the same touches; 10 m where the readings do not determine them."""
    compute_p50_us: float
    compute_p99_us: float
    wire_ms: float
    """SYNC, readings and contacts, in the worst case, without computing."""
    rate_hz: float
    """The arm's own, or the largest that its bus holds."""
    latency_ms: float

    @property
    def share_pct(self) -> float:
        """Computing as a share of the cycle."""
        return 1e-4 * self.compute_p99_us * self.rate_hz


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetPoint(Point):
    """Level full with a budget: what is not done in time keeps the answer of a cheaper level."""

    budget_us: float


BUDGETS: Final = (0.125, 0.25, 0.5)
"""Budgets that are measured, as shares of the computing that level full needs in 99 of 100 cycles."""


CONDITIONS: Final = (
    Condition(name="calibrated, pushed straight", calibrated=True, inclination=0.0),
    Condition(name="as it ships, inclined pushes", calibrated=False, inclination=INCLINATION),
)


class Truth:
    """What an arm feels: an elastic layer under discs, fingers of several sizes, pushed straight or not."""

    def __init__(self, arm: Arm, inclination: float) -> None:
        layer = Elastic()
        geometry = Geometry.of(arm, discs=layer.discs)
        geometry.friction = 1.0 if inclination else None
        self._law = layer.bind(geometry, 0.5 * np.array(FINGERS))
        self._loads, self._touched = Loads(2), np.zeros(arm.n_patches, np.bool_)
        self._arm, self._inclination = arm, inclination

    def feel(self, touches: Floats, link: int, finger: npt.ArrayLike, towards: npt.ArrayLike) -> Floats:
        """Return the pressures (n_tactels,) Pa of touches (n, 3): s, a (m), force (N)."""
        pressures, loads = np.zeros(self._arm.n_tactels), self._loads
        n = loads.n = len(touches)
        loads.link[:n], loads.indenter[:n] = link, finger
        loads.s[:n], loads.a[:n], loads.force[:n] = touches.T
        loads.pull_s[:n] = self._inclination * np.cos(towards)
        loads.pull_a[:n] = self._inclination * np.sin(towards)
        self._law.add(loads, pressures, self._touched)
        return pressures


def measure_headline(
    arm: Arm, *, trials: int = TRIALS, seed: int = SEED, done: Callable[[int], None] = lambda n: None
) -> list[Point]:
    """Return the points of an arm; ``done`` is called with 1 after each."""
    points = []
    for condition in CONDITIONS:
        own = arm.with_law(calibrated_law(arm, seed)) if condition.calibrated else arm
        for fingers in (1, 2):
            drawn = list(_trials(own, condition, fingers, trials, seed))
            for bits in (8, 16):
                read = with_bits(own, bits)
                for level in LEVELS:
                    points.append(_measure(read, condition, fingers, level, bits, drawn))
                    done(1)
    return points


def measure_budgets(
    arm: Arm,
    points: Sequence[Point],
    *,
    trials: int = TRIALS,
    seed: int = SEED,
    done: Callable[[int], None] = lambda n: None,
) -> list[BudgetPoint]:
    """Return level full with less time than it needs, on a calibrated skin with readings of 16 bits.

    points: of the same arm, trials and seed
    """
    condition, found = CONDITIONS[0], []
    read = with_bits(arm.with_law(calibrated_law(arm, seed)), 16)
    for whole in points:
        if (whole.condition, whole.level, whole.bits) != (condition.name, LEVELS[-1], 16):
            continue
        drawn = list(_trials(read, condition, whole.fingers, trials, seed))
        for share in BUDGETS:
            budget_us = float(f"{share * whole.compute_p99_us:.1g}")
            point = _measure(read, condition, whole.fingers, whole.level, 16, drawn, budget_us)
            found.append(BudgetPoint(**asdict(point), budget_us=budget_us))
            done(1)
    return found


def n_points() -> int:
    """Return the number of points of an arm."""
    return len(CONDITIONS) * 2 * 2 * len(LEVELS)


def with_bits(arm: Arm, bits: int) -> Arm:
    """Return the arm with boards whose readings have 8 or 16 bits, everything else as it is."""
    wide = {narrow: eds for eds, narrow in NARROW_EDS.items()}
    names = NARROW_EDS if bits == 8 else wide
    patches = [
        replace(
            placed,
            eds=names.get(placed.eds, placed.eds),
            patch=replace(
                placed.patch,
                transducer=Transducer(full_scale=placed.patch.transducer.full_scale, bits=bits),
            ),
        )
        for placed in arm.patches
    ]
    return Arm(arm.name, arm.links, patches, *arm.buses)


def calibrated_law(arm: Arm, seed: int) -> Law:
    """Return what a calibration of one of the arm's boards makes of its law."""
    placed = arm.patches[0]
    board = Arm.single_patch(placed.patch.tactels_uv, law=placed.patch.law, diameter=placed.patch.diameter)
    truth, rng = Truth(board, 0.0), np.random.default_rng(seed)
    half = np.abs(placed.patch.tactels_uv).max(axis=0) + 0.5 * _pitch(board)
    touches = np.column_stack([rng.uniform(-half, half, (PRESSES, 2)), rng.uniform(*FORCES, PRESSES)])
    readings = np.stack([truth.feel(touch[None], 0, PRESS_FINGER, 0.0) for touch in touches])
    readings += NOISE * rng.standard_normal(readings.shape)
    return learn_radial_law(board, touches[:, 0], touches[:, 1], touches[:, 2], readings).law


@dataclass(frozen=True, slots=True)
class _Trial:
    """One cycle: touches (n, 3), their link, what is felt, and how far an ideal estimate is off, m."""

    touches: Floats
    link: int
    pressures: Floats
    ideal: float


def _trials(arm: Arm, condition: Condition, fingers: int, n: int, seed: int) -> Iterator[_Trial]:
    """Draw cycles; the same for every level and for all bits."""
    rng = np.random.default_rng([seed, fingers])
    truth, pitch = Truth(arm, condition.inclination), _pitch(arm)
    gain = 1.0 if condition.calibrated else 1.0 + GAIN_SPREAD * rng.standard_normal(arm.n_tactels)
    for _ in range(n):
        link, touches = _touches(arm, fingers, pitch, rng)
        finger, towards = rng.integers(len(FINGERS), size=fingers), rng.uniform(0.0, math.tau, fingers)

        def feel(places: Floats) -> Floats:
            return truth.feel(places, link, finger, towards)  # noqa: B023  used within this turn only

        ideal = ideal_distances(bound(feel, touches, NOISE), IDEAL_DRAWS, rng).max(axis=0)
        noisy = feel(touches) * gain + NOISE * rng.standard_normal(arm.n_tactels)
        yield _Trial(touches, link, noisy, float(rng.choice(ideal)))


def _touches(arm: Arm, fingers: int, pitch: float, rng: np.random.Generator) -> tuple[int, Floats]:
    """Return the link and (fingers, 3) s, a (m), force (N): anywhere on the boards."""
    low, high = np.log(FORCES)
    while True:
        i = rng.integers(arm.n_tactels)
        link = int(arm.tactel_link[i])
        surface = arm.links[link].surface
        own = arm.tactel_link == link
        places = np.array([[arm.tactel_s[i], arm.tactel_a[i]]]) + rng.uniform(-0.5, 0.5, (1, 2)) * pitch
        if fingers == 2:
            d, towards = rng.uniform(*APART), rng.uniform(0.0, math.tau)
            second = places[0] + d * np.array([math.cos(towards), math.sin(towards)])
            if (
                np.min(surface.distance(second[0], second[1], arm.tactel_s[own], arm.tactel_a[own]))
                > 0.7 * pitch
            ):
                continue  # beside the boards
            places = np.vstack([places, second])
        places[:, 1] = surface.wrap(places[:, 1])
        return link, np.column_stack([places, np.exp(rng.uniform(low, high, fingers))])


def _measure(
    arm: Arm,
    condition: Condition,
    fingers: int,
    level: str,
    bits: int,
    trials: list[_Trial],
    budget_us: float | None = None,
) -> Point:
    estimator, pitch = Estimator(arm, level), _pitch(arm)
    scale = [placed.patch.transducer for placed in arm.patches]
    errors, times_ns, wrong = [], [], 0
    for number, trial in enumerate([trials[0], *trials]):
        # counts of boards of one kind, all boards of an arm have one transducer
        pressures = scale[0].pressure(scale[0].counts(trial.pressures))
        begin = time.process_time_ns()
        contacts = estimator.update(pressures, number * 1_000_000_000, budget_us=budget_us)
        times_ns.append(time.process_time_ns() - begin)
        if number:  # the first call loads what it needs
            wrong += len(contacts) != fingers
            own, surface = contacts.link == trial.link, arm.links[trial.link].surface
            s, a = contacts.s[own], contacts.a[own]
            errors.append(cycle_error(surface, trial.touches, s, a, int((~own).sum()), pitch))
    p50_us, p99_us = np.percentile(times_ns[1:], [50, 99]) / 1e3
    rate_hz, wire_ns = _wire(arm, round(1e3 * p99_us))
    return Point(
        arm=arm.name,
        condition=condition.name,
        fingers=fingers,
        level=level,
        bits=bits,
        p50_mm=1e3 * float(np.median(errors)),
        p95_mm=1e3 * float(np.percentile(errors, 95)),
        wrong_count_pct=100.0 * wrong / len(trials),
        bound_p95_mm=1e3 * float(np.percentile([min(t.ideal, 10.0) for t in trials], 95)),
        compute_p50_us=float(p50_us),
        compute_p99_us=float(p99_us),
        wire_ms=1e-6 * wire_ns,
        rate_hz=rate_hz,
        latency_ms=500.0 / rate_hz + 1e-6 * wire_ns + 1e-3 * float(p99_us),
    )


def cycle_error(
    surface: Surface, touches: Floats, s: Floats, a: Floats, elsewhere: int, pitch: float
) -> float:
    """Return the error of a cycle, m: of its worst touch; a pitch at least where the count is wrong.

    s, a:       (n,) m, of the contacts on the link that is touched; ``elsewhere`` is how many others have
    """
    d = np.asarray(surface.distance(touches[:, :1], touches[:, 1:2], s, a))
    rows, columns = linear_sum_assignment(np.minimum(d, 10.0 * GATE))
    near = d[rows, columns] <= GATE
    errors = d[rows[near], columns[near]].tolist()
    if near.sum() < max(len(touches), len(s) + elsewhere):
        errors.append(pitch)
    return float(max(errors))


def _wire(arm: Arm, compute_ns: int) -> tuple[float, int]:
    """Return the rate that the buses hold, at most the arm's own (Hz), and the time on the wire, ns."""
    computes = {"level": compute_ns}
    found = plans(arm, computes, level="level")
    if not all(plan.holds for plan in found):
        rate_hz = min(plan.levels[0].largest_hz for plan in found)
        found = plans(arm, computes, level="level", rate_hz=rate_hz)
    published = [plan.published_ns for plan in found]
    known = [ns for ns in published if ns is not None]
    return found[0].rate_hz, max(known) - compute_ns


def _pitch(arm: Arm) -> float:
    """Return the usual distance of a tactel from its nearest neighbour on a board, m."""
    boards = {id(placed.patch): placed.patch.tactels_uv for placed in arm.patches}
    # the nearest is the tactel itself
    nearest = [np.asarray(KDTree(uv).query(uv, 2)[0])[:, 1] for uv in boards.values()]
    return float(np.median(np.concatenate(nearest)))
