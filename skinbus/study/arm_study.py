"""Accuracy against time of one arm: latency against the error in 95 of 100 cycles, by level.

Fingers press anywhere on the boards of an arm, alone or two near each other: on a skin that is calibrated
and pressed straight, and on one with the law that ships under inclined pushes. The error of a cycle is that
of its worst touch; one that is missed, merged with another, or beside a contact where no touch is, counts as
a pitch at least. How far that error would differ in other draws is a bootstrap of the cycles (Efron 1979).
The latency is from touch to contact: half a period until the next SYNC, readings and
contacts on the wire in the worst case, and 99 % of the computing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.arrays import Floats
from skinbus.estimate import LEVELS, Estimator, learn_radial_law
from skinbus.model import Arm, Law, Surface, Transducer
from skinbus.planning.plan import plans
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads

if TYPE_CHECKING:
    from matplotlib.figure import Figure


DIAMETERS = (0.010, 0.012, 0.015)
"""Of fingertips, m."""
PRESSES = 300
"""Of a calibration, by the middle one of the fingertips."""
FORCES = (2.0, 12.0)
"""N, evenly spread in the logarithm."""
APART = (0.015, 0.025)
"""Distance of two fingers that come together, m."""
NOISE = 200.0
"""Pa, as in the EDS files."""
GAIN_SPREAD = 0.03
INCLINATION = 0.3
"""Tangential force per normal force of an inclined push: that of a hand that leans on an arm."""
GATE = 0.020
"""m; a contact further than this from a touch is not that touch: two tactels of the default board."""
SEED = 16
"""Of all draws."""
RESAMPLES = 400
SCATTER = (5.0, 95.0)
"""Percentiles of the bootstrap between which the error of other draws is expected."""
CALIBRATED = "calibrated, pushed straight"
SHIPPED = "as it ships, inclined pushes"
CONDITIONS = (CALIBRATED, SHIPPED)
FINGERS = {1: "one finger", 2: "two fingers, 15-25 mm apart"}
BITS = (8, 16)
NARROW_EDS = {"skin-patch": "skin-patch-8bit"}
"""Boards that ship with an EDS of fewer bits."""
N_POINTS = len(CONDITIONS) * len(FINGERS) * len(BITS) * len(LEVELS)
"""Of an arm."""


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
    low_mm: float
    """From here to ``high_mm`` the 95th percentile scatters over draws."""
    high_mm: float
    wrong_count_pct: float
    """Of the cycles: not as many contacts as touches."""
    wrong_scatter_pct: float
    """Standard deviation of that share."""
    compute_p99_us: float
    wire_ms: float
    """SYNC, readings and contacts, in the worst case, without computing."""
    rate_hz: float
    """The arm's own, or the largest that its bus holds."""
    latency_ms: float


def truth_of(arm: Arm, inclination: float) -> Callable[[Floats, int, npt.ArrayLike, npt.ArrayLike], Floats]:
    """Return what an arm feels: an elastic layer under fingers of several sizes, pushed straight or not.

    It gives pressures (n_tactels,) Pa for touches (n, 3) s, a (m), force (N), their link, the number of each
    finger and the direction of its push.
    """
    layer = Elastic()
    geometry = Geometry.of(arm, discs=layer.discs)
    geometry.friction = 1.0 if inclination else None
    law = layer.bind(geometry, [Indenter(Shape.DISC, d) for d in DIAMETERS])

    def feel(touches: Floats, link: int, finger: npt.ArrayLike, towards: npt.ArrayLike) -> Floats:
        pressures, (s, a, force) = np.zeros(arm.n_tactels), touches.T
        pull = {"pull_s": inclination * np.cos(towards), "pull_a": inclination * np.sin(towards)}
        law.add(Loads(len(s), link=link, indenter=finger, s=s, a=a, force=force, **pull), pressures)
        return pressures

    return feel


def measure_arm(
    arm: Arm,
    *,
    trials: int = 400,
    done: Callable[[int], None] = lambda n: None,
) -> list[Point]:
    """Return the points of an arm: by condition, bits, fingers and level.

    Args:
        arm: what is pressed; its law is that of the condition "as it ships".
        trials: cycles of each point; the 95th percentile of 400 rests on 20 of them.
        done: called with 1 after each point.
    """
    points = []
    for condition in CONDITIONS:
        own = arm.with_law(calibrated_law(arm)) if condition == CALIBRATED else arm
        drawn = {fingers: list(_trials(own, condition, fingers, trials)) for fingers in FINGERS}
        for bits, fingers, level in product(BITS, FINGERS, LEVELS):
            points.append(_measure(with_bits(own, bits), condition, fingers, level, bits, drawn[fingers]))
            done(1)
    return points


def with_bits(arm: Arm, bits: int) -> Arm:
    """Return the arm with boards whose readings have 8 or 16 bits, everything else as it is."""
    wide = {narrow: eds for eds, narrow in NARROW_EDS.items()}
    names = NARROW_EDS if bits == 8 else wide
    patches = []
    for placed in arm.patches:
        transducer = Transducer(full_scale=placed.patch.transducer.full_scale, bits=bits)
        patch = replace(placed.patch, transducer=transducer)
        patches.append(replace(placed, eds=names.get(placed.eds, placed.eds), patch=patch))
    return Arm(arm.name, arm.links, patches, *arm.buses)


def calibrated_law(arm: Arm) -> Law:
    """Return what a calibration of one of the arm's boards makes of its law."""
    placed = arm.patches[0]
    board = Arm.single_patch(placed.patch.tactels_uv, law=placed.patch.law, diameter=placed.patch.diameter)
    feel, rng = truth_of(board, 0.0), np.random.default_rng(SEED)
    half = np.abs(placed.patch.tactels_uv).max(axis=0) + 0.5 * placed.patch.pitch
    touches = np.column_stack([rng.uniform(-half, half, (PRESSES, 2)), rng.uniform(*FORCES, PRESSES)])
    readings = np.stack([feel(touch[None], 0, 1, 0.0) for touch in touches])
    readings += NOISE * rng.standard_normal(readings.shape)
    return learn_radial_law(board, touches[:, 0], touches[:, 1], touches[:, 2], readings).law


class _Trial(NamedTuple):
    """One cycle: touches (n, 3), their link, and what is felt, Pa."""

    touches: Floats
    link: int
    pressures: Floats


def _trials(arm: Arm, condition: str, fingers: int, n: int) -> Iterator[_Trial]:
    """Draw cycles; the same for every level and for all bits."""
    rng = np.random.default_rng([SEED, fingers])
    is_shipped, pitch = condition == SHIPPED, arm.patches[0].patch.pitch
    feel = truth_of(arm, INCLINATION if is_shipped else 0.0)
    gain = 1.0 + GAIN_SPREAD * rng.standard_normal(arm.n_tactels) if is_shipped else 1.0
    for _ in range(n):
        link, touches = _touches(arm, fingers, pitch, rng)
        finger, towards = rng.integers(len(DIAMETERS), size=fingers), rng.uniform(0.0, math.tau, fingers)
        noisy = feel(touches, link, finger, towards) * gain
        yield _Trial(touches, link, noisy + NOISE * rng.standard_normal(arm.n_tactels))


def _touches(arm: Arm, fingers: int, pitch: float, rng: np.random.Generator) -> tuple[int, Floats]:
    """Return the link and (fingers, 3) s, a (m), force (N): anywhere on the boards."""
    while True:
        i = rng.integers(arm.n_tactels)
        link = int(arm.tactel_link[i])
        surface, own = arm.links[link].surface, arm.tactel_link == link
        first = np.array([arm.tactel_s[i], arm.tactel_a[i]]) + rng.uniform(-0.5, 0.5, 2) * pitch
        d, towards = rng.uniform(*APART), rng.uniform(0.0, math.tau)
        places = first + np.array([(0.0, 0.0), (d * math.cos(towards), d * math.sin(towards))])[:fingers]
        nearest = surface.distance(places[-1, 0], places[-1, 1], arm.tactel_s[own], arm.tactel_a[own]).min()
        if fingers == 1 or nearest <= 0.7 * pitch:  # else the second is beside the boards
            force = np.exp(rng.uniform(math.log(FORCES[0]), math.log(FORCES[1]), fingers))
            return link, np.column_stack([places[:, 0], surface.wrap(places[:, 1]), force])


def _measure(arm: Arm, condition: str, fingers: int, level: str, bits: int, trials: list[_Trial]) -> Point:
    estimator, pitch = Estimator(arm, level), arm.patches[0].patch.pitch
    transducer = arm.patches[0].patch.transducer  # all boards of an arm have one
    errors, times_ns, wrong = [], [], 0
    for number, trial in enumerate([trials[0], *trials]):
        pressures = transducer.pressure(transducer.counts(trial.pressures))
        begin = time.process_time_ns()
        contacts = estimator.update(pressures, number * 1_000_000_000)
        times_ns.append(time.process_time_ns() - begin)
        if number:  # the first call loads what it needs
            wrong += len(contacts) != fingers
            own, surface = contacts.link == trial.link, arm.links[trial.link].surface
            found = contacts.s[own], contacts.a[own]
            errors.append(cycle_error(surface, trial.touches, *found, len(contacts), pitch))
    p99_us = 1e-3 * float(np.percentile(times_ns[1:], 99))
    rate_hz, wire_ns = _wire(arm, round(1e3 * p99_us))
    p50_mm, p95_mm = (1e3 * np.percentile(errors, [50, 95])).tolist()
    low_mm, high_mm = 1e3 * _scatter_of_p95(np.array(errors))
    share = wrong / len(trials)
    return Point(
        arm=arm.name,
        condition=condition,
        fingers=fingers,
        level=level,
        bits=bits,
        p50_mm=p50_mm,
        p95_mm=p95_mm,
        low_mm=float(low_mm),
        high_mm=float(high_mm),
        wrong_count_pct=100.0 * share,
        wrong_scatter_pct=100.0 * math.sqrt(share * (1.0 - share) / len(trials)),
        compute_p99_us=p99_us,
        wire_ms=1e-6 * wire_ns,
        rate_hz=rate_hz,
        latency_ms=500.0 / rate_hz + 1e-6 * wire_ns + 1e-3 * p99_us,
    )


def _scatter_of_p95(errors: Floats) -> Floats:
    """Return between which errors (2,) the 95th percentile of other draws is expected."""
    again = np.random.default_rng(0).choice(errors, (RESAMPLES, len(errors)))
    return np.array(np.percentile(np.percentile(again, 95, axis=1), SCATTER))


def cycle_error(surface: Surface, touches: Floats, s: Floats, a: Floats, n_found: int, pitch: float) -> float:
    """Return the error of a cycle, m: of its worst touch; a pitch at least where the count is wrong.

    Args:
        surface: of the link that is touched.
        touches: (n, 3) s, a (m), force (N).
        s: (m,) of the contacts on that link, m.
        a: (m,) likewise, m.
        n_found: number of contacts on all links.
        pitch: what a wrong count costs, m.
    """
    d = np.asarray(surface.distance(touches[:, :1], touches[:, 1:2], s, a))
    rows, columns = linear_sum_assignment(np.minimum(d, 10.0 * GATE))
    near = d[rows, columns] <= GATE
    errors = d[rows[near], columns[near]].tolist()
    if near.sum() < max(len(touches), n_found):
        errors.append(pitch)
    return float(max(errors))


def _wire(arm: Arm, compute_ns: int) -> tuple[float, int]:
    """Return the rate that the buses hold, at most the arm's own (Hz), and the time on the wire, ns."""
    plan_arm = partial(plans, arm, {"level": compute_ns}, level="level")
    found = plan_arm()
    if not all(plan.holds for plan in found):
        found = plan_arm(rate_hz=min(plan.levels[0].largest_hz for plan in found))
    return found[0].rate_hz, max(plan.published_ns or 0 for plan in found) - compute_ns


def decide(points: Sequence[Point]) -> Point:
    """Return the point to run: the cheapest of those that no scatter separates from the best."""
    best = min(points, key=lambda p: p.p95_mm)
    good = [p for p in points if p.low_mm <= best.high_mm]
    # where all are off by a pitch or more, the count decides
    fewest = min(good, key=lambda p: p.wrong_count_pct)
    least = fewest.wrong_count_pct + 2.0 * fewest.wrong_scatter_pct
    good = [p for p in good if p.wrong_count_pct - 2.0 * p.wrong_scatter_pct <= least]
    return min(good, key=lambda p: LEVELS.index(p.level))


def situations(points: Sequence[Point]) -> list[Sequence[Point]]:
    """Return the levels of each arm, condition, bits and number of fingers."""
    return [points[k : k + len(LEVELS)] for k in range(0, len(points), len(LEVELS))]


TITLES = ("boards", *LEVELS, "run", "touch to contact")
"""Of the columns of ``table``."""


def table(points: Sequence[Point]) -> list[list[str]]:
    """Return a row for each arm, bits and condition; cells are "one finger / two (their wrong counts)"."""
    rows = []
    found = situations(points)
    for one, two in zip(found[::2], found[1::2], strict=True):
        cells = [
            f"{p.p95_mm:.2g} / {q.p95_mm:.2g} mm ({q.wrong_count_pct:.0f} %)"
            for p, q in zip(one, two, strict=True)
        ]
        p, q = decide(one), decide(two)
        boards = f"{p.arm}, {p.bits} bit, {p.condition}"
        rows.append([boards, *cells, f"{p.level} / {q.level}", f"{p.latency_ms:.0f} / {q.latency_ms:.0f} ms"])
    return rows


def draw_arm(points: Sequence[Point]) -> Figure:
    """Draw one arm, calibrated: a panel for each number of bits, a line for each level, one finger to two."""
    from skinbus.study.draw import COLOURS, MARKERS, new_figure

    figure, panels = new_figure(len(BITS), 1, width=4.6, height=4.0)
    own = [p for p in points if p.condition == CALIBRATED]
    for axes, bits in zip(panels[0], BITS, strict=True):
        here = [p for p in own if p.bits == bits]
        for level in LEVELS:
            line = [p for p in here if p.level == level]
            x, y = [p.latency_ms for p in line], [p.p95_mm for p in line]
            low = [p.p95_mm - p.low_mm for p in line]
            high = [p.high_mm - p.p95_mm for p in line]
            axes.errorbar(x, y, [low, high], color=COLOURS[level], lw=1, capsize=3, label=level)
            for p in line:
                filled = COLOURS[level] if p.fingers == 1 else "white"
                axes.plot(p.latency_ms, p.p95_mm, MARKERS[level], color=COLOURS[level], mfc=filled, ms=7)
        for alternatives in situations(here):
            run = decide(alternatives)
            axes.plot(run.latency_ms, run.p95_mm, "ko", ms=16, mfc="none")
        axes.set(
            title=f"{bits} bit, {here[0].rate_hz:g} Hz",
            xlabel="touch to contact: SYNC, wire, computing (ms)",
            ylabel="error in 95 of 100 cycles (mm)",
            yscale="log",
            ylim=(0.7 * min(p.low_mm for p in own), 1.4 * max(p.high_mm for p in own)),
        )
    axes.legend()
    figure.suptitle(
        f"{points[0].arm}, {CALIBRATED}\nfilled: {FINGERS[1]}; open: {FINGERS[2]}; ringed: the level to run"
    )
    return figure
