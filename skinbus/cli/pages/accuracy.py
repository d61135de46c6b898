"""The page that says what accuracy costs on an arm, and which level to run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from skinbus.cli.pages.page import card, grid, page, table, text
from skinbus.cli.pages.plot import Axis, Plot, legend, marker
from skinbus.estimate import LEVELS
from skinbus.study.headline import CONDITIONS, BudgetPoint, Point
from skinbus.study.headline_figure import FINGERS, UNBOUND_MM, decide

COLOURS: Final = {"kmeans": "orange", "fit": "blue", "full": "green"}
CALIBRATED, SHIPPED = CONDITIONS


def accuracy_page(points: Sequence[Point], facts: Mapping[str, str], made: str) -> str:
    """Return the page of one arm or more.

    facts: what each arm is, by its name
    made:  how the numbers were measured
    """
    arms = list(dict.fromkeys(point.arm for point in points))
    on = f" on {text(arms[0])}" if len(arms) == 1 else ""
    parts = [
        f"<h1>What accuracy costs{on}, and which level to run</h1>",
        '<p class="dim">Error of the worst touch in 95 of 100 cycles against the time from touch to contact: '
        "wait for the SYNC, wire and computing together. A wrong count is an error of a pitch at least.</p>",
    ]
    for name in arms:
        own = [point for point in points if point.arm == name]
        if len(arms) > 1:
            parts.append(f"<h2>{text(name)}</h2>")
        if fact := facts.get(name):
            parts.append(f'<p class="dim">{text(fact)}</p>')
        parts += [_cards(own), _picture(own), _bought(own), _details(own)]
    parts.append(f"<h2>How this was measured</h2><p>{text(made)}</p>")
    return page(f"skinbus: accuracy of {', '.join(arms)}", *parts)


def _pick(points: Sequence[Point], condition: str, fingers: int) -> list[Point]:
    """Return the points of a situation without budgets."""
    return [
        point
        for point in points
        if (point.condition, point.fingers) == (condition, fingers) and not isinstance(point, BudgetPoint)
    ]


def _cards(points: Sequence[Point]) -> str:
    """Return which level to run in each situation."""
    cards = []
    for condition in CONDITIONS:
        for fingers, words in FINGERS.items():
            own = _pick(points, condition.name, fingers)
            if not own:
                continue
            best = decide(own)
            cards.append(
                card(
                    f"{_capital(words)}; {condition.name}",
                    f'<div class="big">run <code>{best.level}</code>, {best.bits} bit</div>'
                    f"<p><b>{best.p95_mm:.2g}&nbsp;mm</b> in 95 of 100 cycles, "
                    f'<b>{best.latency_ms:.0f}&nbsp;ms</b> from touch to contact<br><span class="dim">'
                    f"count wrong in {best.wrong_count_pct:.0f} % of the cycles; "
                    f"computing {_time(best.compute_p99_us)}, "
                    f"{best.share_pct:.1f} % of {best.rate_hz:.3g}&nbsp;Hz</span></p>",
                )
            )
    return grid(*cards, least=270)


def _picture(points: Sequence[Point]) -> str:
    times = [point.latency_ms for point in points]
    bounds = [point.bound_p95_mm for point in points if point.bound_p95_mm < UNBOUND_MM]
    errors = [point.p95_mm for point in points] + bounds
    panels = []
    for fingers, words in FINGERS.items():
        x = Axis(0.93 * min(times), 1.07 * max(times), "touch to contact, ms", log=True)
        y = Axis(0.8 * min(errors), 1.25 * max(errors), "error in 95 of 100 cycles, mm", log=True)
        plot = Plot(x, y, f"{words}: error against time")
        for condition in (SHIPPED, CALIBRATED):
            own = [p for p in points if (p.condition, p.fingers) == (condition.name, fingers)]
            if own and condition is CALIBRATED and own[0].bound_p95_mm < UNBOUND_MM:
                bound = own[0].bound_p95_mm
                plot.line([x.low, x.high], [bound, bound], "dim", dash="5 4", width=1.5)
                plot.note(
                    x.high, bound, f"ideal unbiased estimator {bound:.2g} mm", dx=-5, dy=14, anchor="end"
                )
            for point in own:
                budget = isinstance(point, BudgetPoint)
                plot.point(
                    point.latency_ms,
                    point.p95_mm,
                    COLOURS[point.level],
                    _tip(point),
                    shape="diamond" if budget else "square" if point.bits == 8 else "circle",
                    hollow=condition is SHIPPED,
                    size=4.5 if budget else 6 + 1.5 * (len(LEVELS) - 1 - LEVELS.index(point.level)),
                )
        panels.append(card(_capital(words), plot.svg()))
    entries = [(marker(8, 8, COLOURS[level], size=6), level) for level in LEVELS]
    entries += [
        (marker(8, 8, "dim", size=6), "16 bit"),
        (marker(8, 8, "dim", shape="square", size=6), "8 bit"),
        (marker(8, 8, "dim", size=6), CALIBRATED.name),
        (marker(8, 8, "dim", size=6, hollow=True), SHIPPED.name),
    ]
    if any(isinstance(point, BudgetPoint) for point in points):
        entries.append((marker(8, 8, "dim", shape="diamond", size=5.5), "with a budget"))
    return f"<h2>Error against time</h2>{legend(*entries)}{grid(*panels)}"


def _bought(points: Sequence[Point]) -> str:
    """Return what ships, what a calibrated skin pushed straight has, and what an ideal estimator would."""
    rows = []
    for fingers, words in FINGERS.items():
        for condition in (SHIPPED, CALIBRATED):
            own = _pick(points, condition.name, fingers)
            if own:
                best = decide(own)
                bound = f"{best.bound_p95_mm:.2g}" if best.bound_p95_mm < UNBOUND_MM else "not determined"
                rows.append(
                    (
                        f"{words.partition(',')[0]}; {condition.name.partition(',')[0]}",
                        f"{best.level}, {best.bits} bit",
                        f"{best.p50_mm:.2g}",
                        f"{best.p95_mm:.2g}",
                        bound,
                        f"{best.wrong_count_pct:.0f}",
                    )
                )
    heads = [
        "situation",
        "level",
        "median error, mm",
        "in 95 of 100, mm",
        "ideal unbiased estimator, mm",
        "count wrong, %",
    ]
    return (
        "<h2>What ships, and what calibration and straight pushes give</h2>"
        "<p>The law that ships is not that of your cover; <code>skinbus calibrate</code> learns yours. An "
        "inclined push moves a contact towards where it pushes, which no calibration takes away.</p>"
        + table(heads, rows)
    )


def _details(points: Sequence[Point]) -> str:
    heads = [
        "level",
        "bits",
        "budget, us",
        "median, mm",
        "95 of 100, mm",
        "count wrong, %",
        "computing 50 %, us",
    ]
    heads += ["99 %, us", "of the cycle, %", "wire, ms", "rate, Hz", "touch to contact, ms"]
    parts = ["<h2>All points</h2>", '<p class="dim">Bold: what to run.</p>']
    for condition in CONDITIONS:
        for fingers, words in FINGERS.items():
            own = [p for p in points if (p.condition, p.fingers) == (condition.name, fingers)]
            if not own:
                continue
            best = decide(_pick(points, condition.name, fingers))
            rows = [
                (
                    p.level,
                    p.bits,
                    f"{p.budget_us:.0f}" if isinstance(p, BudgetPoint) else "none",
                    f"{p.p50_mm:.2g}",
                    f"{p.p95_mm:.2g}",
                    f"{p.wrong_count_pct:.0f}",
                    f"{p.compute_p50_us:.0f}",
                    f"{p.compute_p99_us:.0f}",
                    f"{p.share_pct:.1f}",
                    f"{p.wire_ms:.1f}",
                    f"{p.rate_hz:.3g}",
                    f"{p.latency_ms:.1f}",
                )
                for p in own
            ]
            caption = f"<h3>{text(_capital(words))}; {text(condition.name)}</h3>"
            parts.append(caption + table(heads, rows, [k for k, p in enumerate(own) if p is best]))
    return "\n".join(parts)


def _tip(point: Point) -> str:
    budget = f", budget {_time(point.budget_us)}" if isinstance(point, BudgetPoint) else ""
    return (
        f"{point.level}, {point.bits} bit{budget}\n{point.condition}\n"
        f"{point.p95_mm:.2g} mm in 95 of 100 cycles, median {point.p50_mm:.2g} mm\n"
        f"count wrong in {point.wrong_count_pct:.0f} %\n"
        f"{point.latency_ms:.1f} ms: half a period {500.0 / point.rate_hz:.1f}, wire {point.wire_ms:.1f}, "
        f"computing {1e-3 * point.compute_p99_us:.2f}\n"
        f"{point.share_pct:.1f} % of the cycle at {point.rate_hz:.3g} Hz"
    )


def _capital(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}"


def _time(us: float) -> str:
    return f"{1e-3 * us:.1f} ms" if us >= 1000.0 else f"{us:.0f} us"
