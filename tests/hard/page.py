"""The page on hard cases, made from measurements: table of cases, rounding, scatter, extremes, curves."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

from skinbus.estimate import LEVELS, Quality
from skinbus.study.marked import Marks
from tests.hard.catalogue import CASES
from tests.hard.check import WORK_PER_TACTEL, Outcome, run_case
from tests.hard.curves import FAMILIES, Point, draw_curves, measure_curves
from tests.hard.effects import EFFECTS, EffectOutcome, run_effect
from tests.hard.extremes import Extremes, run_extremes
from tests.hard.ground import LAWS, SURFACES, Ground
from tests.hard.rounding import Rounding, measure_rounding
from tests.hard.scatter import SPOTS, Scatter, measure_scatter

Done = Callable[[int], None]

MARKS: Final = Marks("<!-- measured: begin -->", "<!-- measured: end -->")
N_CURVES: Final = sum(len(family[3]) for family in FAMILIES.values())
N_STEPS: Final = len(CASES) + len(EFFECTS) + N_CURVES + 2 * len(SPOTS)


def make_page(page: Path, figures: Path, *, cycles: int, answers: int, seed: int, done: Done) -> list[str]:
    """Measure everything, write it between the marks of a page, draw the curves; return the faults."""
    table, faults = case_table(done)
    effects, more = effect_table(done)
    faults += more
    curves = measure_curves(done=done)
    draw_curves(curves, figures)
    scatter = []
    for spot in SPOTS:
        for law in LAWS:
            scatter.append(measure_scatter(spot, law, answers, seed))
            done(1)
    extremes = run_extremes(cycles, seed)
    parts = [
        table,
        effects,
        rounding_table(measure_rounding()),
        scatter_table(scatter),
        extremes_text(extremes, seed),
        curve_table(curves),
    ]
    MARKS.write(page, "\n\n".join(parts) + "\n")
    return [*faults, *extremes.faults]


def case_table(done: Done) -> tuple[str, list[str]]:
    """Return the table of cases with the worst of all surfaces and laws at each level, and the faults."""
    lines, faults = [], []
    for case in CASES:
        cells = []
        for level in LEVELS:
            outcomes = []
            for surface in SURFACES:
                for law in LAWS:
                    outcome = run_case(case, Ground(surface, law), level)
                    if outcome is None:
                        continue
                    outcomes.append(outcome)
                    faults += [f"{case.name}, {surface}, {law}, {level}: {f}" for f in outcome.faults]
            cells.append(_cell(outcomes))
        lines.append([case.name, case.why, case.holds, *cells])
        done(1)
    head = ["case", "why it is hard", "what must hold", *LEVELS]
    text = (
        "### Cases\n\nOf all surfaces and laws the worst: contacts; place off by; force off by; reported "
        "standard deviation of the place, mm;\nflags (F few tactels, S saturated, N not converged, "
        "M misfit, B over budget).\n\n"
    )
    return text + _table(head, lines), faults


def effect_table(done: Done) -> tuple[str, list[str]]:
    """Return the table of effects of a real skin at each level, and the faults."""
    lines, faults = [], []
    for name in EFFECTS:
        for level in LEVELS:
            outcome = run_effect(name, level)
            lines.append([name, level, *_effect_cells(outcome)])
            faults += [f"{name}, {level}: {fault}" for fault in outcome.faults]
        done(1)
    head = [
        "effect",
        "level",
        "cycles",
        "missed",
        "false",
        "flagged",
        "beyond 6 sd",
        "worst mm",
        "worst force %",
    ]
    text = (
        "### Effects of a real skin\n\n"
        "Fingers of 12 mm (a sphere of 16 mm where the contact grows) press the arm `pad` with the law that "
        "ships, half a second each;\nevery cycle with a touch of over 0.5 N is counted. Beyond: contacts "
        "without a flag that are further from the touch\nthan six of their standard deviations.\n\n"
    )
    return text + _table(head, lines), faults


def _effect_cells(outcome: EffectOutcome) -> list[str]:
    counts = (outcome.n_touches, outcome.n_missed, outcome.n_false, outcome.n_flagged, outcome.n_beyond)
    return [*map(str, counts), f"{outcome.worst_mm:.1f}", f"{100.0 * outcome.worst_force:.0f}"]


def _cell(outcomes: Sequence[Outcome]) -> str:
    counts = sorted({o.n for o in outcomes})
    words = [str(counts[0]) if len(counts) == 1 else f"{counts[0]}–{counts[-1]}"]
    place = _largest(o.place for o in outcomes)
    force = _largest(o.force for o in outcomes)
    sigma = max(o.sigma_place for o in outcomes)
    if math.isfinite(place):
        words.append(f"{_short(1e3 * place)} mm")
    if math.isfinite(force):
        words.append(f"{_short(100 * force)} %")
    if sigma:
        words.append(f"± {_short(1e3 * sigma)}")
    flags = Quality(0)
    for o in outcomes:
        flags |= o.quality
    letters = "".join(letter for letter, flag in zip("FSNMB", (1, 2, 4, 8, 16), strict=True) if flags & flag)
    return "; ".join([*words, letters] if letters else words)


def rounding_table(rows: Sequence[Rounding]) -> str:
    """Return the table of errors against 50 digits."""
    lines = [[r.quantity, f"{r.largest:.1f}", f"{r.median:.2f}", str(r.n)] for r in rows]
    return "### Rounding of the laws\n\n" + _table(["quantity", "largest, ulp", "median, ulp", "of"], lines)


def scatter_table(rows: Sequence[Scatter]) -> str:
    """Return the table of scatter over report."""
    lines = [
        [
            r.spot,
            r.law,
            str(r.n),
            f"{100 * r.right:.2f} %",
            *(f"{v:.3f}" for v in (r.s, r.a, r.force, r.nees)),
        ]
        for r in rows
    ]
    head = ["touch", "law", "answers", "right count", "s", "a", "force", "NEES (3)"]
    return "### Scatter of the answers over reported standard deviation\n\n" + _table(head, lines)


def extremes_text(result: Extremes, seed: int) -> str:
    """Return what random extremes gave."""
    kinds = Counter(fault.split(": ", 1)[1] for fault in result.faults)
    words = "no fault" if not kinds else ", ".join(f"{n} x {kind}" for kind, n in kinds.items())
    return (
        f"### Extremes at random\n\n{result.n} cycles (seed {seed}), {result.n_contacts} contacts, at most "
        f"{result.most_contacts} in a cycle: {words}. Work: at most\n"
        f"{result.most_work:.0f} pressures evaluated "
        f"per tactel (bound {WORK_PER_TACTEL}), {result.most_ms:.0f} ms of processor time."
    )


def curve_table(points: Sequence[Point]) -> str:
    """Return the points of the curves."""
    lines = [
        [
            FAMILIES[p.family][0],
            f"{1e3 * p.hardness:.4g}",
            p.level,
            f"{p.condition:.1e}",
            f"{p.error_mm:.3f}",
            f"{p.sigma_mm:.3f}" if p.level != LEVELS[0] else "",
            f"{100 * p.dishonest:.0f} %" if p.level != LEVELS[0] else "",
        ]
        for p in points
    ]
    head = ["family", "mm", "level", "condition", "error, mm", "reported, mm", "beyond 6 sigma"]
    return "### Points of the curves\n\n" + _table(head, lines)


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _largest(values: Iterable[float]) -> float:
    known = [v for v in values if math.isfinite(v)]
    return max(known) if known else math.nan


def _short(value: float) -> str:
    return "0" if value < 1e-6 else f"{value:.2g}" if value < 100 else f"{value:.0f}"
