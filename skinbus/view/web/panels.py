"""The panels of the page as text: what the cycle, the boards and the source are doing; escaped for HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Final

import numpy as np

from skinbus.model import Arm
from skinbus.printable import printable
from skinbus.skin.cycle import Cycle, CycleFlags, Patch, PatchState, TactelFault
from skinbus.skin.pressed import Loads
from skinbus.view.web import colours
from skinbus.view.web.drawing import LEAST_N, Drawing
from skinbus.view.web.history import Floats, History

STATES: Final = {
    PatchState.UNUSED: ("not in the arm file", "lost"),
    PatchState.ABSENT: ("absent", "lost"),
    PatchState.BOOTING: ("booting", "waiting"),
    PatchState.WRONG: ("wrong device", "lost"),
    PatchState.OPERATIONAL: ("operational", "good"),
    PatchState.SILENT: ("silent", "lost"),
}
N_BINS: Final = 32
"""Bars of the latency histogram: 0.6 ms each at 50 Hz."""
BARS: Final = "\u00b7\u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588"
"""From none to the most; characters, for each drawing sends them anew."""
UNKNOWN: Final = "not known from here"
MOST_MARKS: Final = 8
"""Marks of a recording that are listed, the last ones."""
STYLE: Final = """<style>
.sb{font:13px/1.45 system-ui,sans-serif;padding:0 .75em;overflow-wrap:anywhere}
.sb table{border-collapse:collapse;width:100%;font-size:12px;font-variant-numeric:tabular-nums}
.sb td,.sb th{padding:.1em .3em;text-align:left;white-space:nowrap}
.sb th{font-weight:600;opacity:.65}
.sb .n{text-align:right}
.sb .good{color:#2b8a3e}.sb .waiting{color:#e67700}.sb .lost{color:#e03131;font-weight:600}
.sb .key{opacity:.65}
.sb .bar{height:.7em;border-radius:.2em;margin:.2em 0}
.sb .badge{border-radius:.8em;padding:.05em .6em;color:#fff;font-weight:600}
.sb .ends{display:flex;justify-content:space-between}
.sb .marks{display:flex;flex-wrap:wrap;gap:0 .9em}.sb .marks>span{white-space:nowrap}
.sb .bars{font:1.1em/1.2 monospace;margin:.3em 0 0;white-space:nowrap;overflow:hidden}
.sb .scroll{max-height:34em;overflow:auto}
</style>"""


def text(value: object) -> str:
    """Return what strangers wrote, fit for HTML."""
    return escape(printable(str(value)))


def legend(full_kpa: float = colours.FULL_KPA) -> str:
    """Return the legend of pressures and marks."""
    ticks = "".join(f"<span>{full_kpa * k / 4:g}</span>" for k in range(5))
    marks = "".join(
        f'<span><span style="color:rgb{colour}">{sign}</span> {name}</span>'
        for sign, colour, name in (
            ("&#10140;", colours.CONTACT, "contact &plusmn; 3&sigma;"),
            ("&#10140;", colours.TRUTH, "truth"),
            ("&#9711;", colours.PUBLISHED, "published"),
            ("&#10005;", colours.LOST, "lost or bad"),
            ("&#9679;", colours.UNKNOWN, "no reading"),
        )
    )
    return (
        f'{STYLE}<div class="sb"><div class="bar" style="background:{colours.gradient()}"></div>'
        f'<div class="ends">{ticks}</div><div class="key">pressure, kPa</div>'
        f'<div class="marks">{marks}</div></div>'
    )


def boards(cycle: Cycle, arm: Arm) -> str:
    """Return the health of every board, those that need attention first."""
    rows = []
    faults = cycle.readings.faults
    for number, patch in enumerate(cycle.patches):
        here = faults[arm.tactels_of(number)]
        rows.append((_rank(patch, bool(here.any())), number, patch, here))
    rows.sort(key=lambda row: row[:2])
    cells = "".join(_board_row(patch, here) for _, _, patch, here in rows)
    n_good = sum(patch.state is PatchState.OPERATIONAL for patch in cycle.patches)
    return (
        f'{STYLE}<div class="sb"><div>{n_good} of {len(rows)} boards operational</div>'
        '<div class="scroll"><table><tr><th class="n">node</th><th>link</th><th>state</th>'
        f'<th class="n">ms</th><th>EMCY</th><th>tactels</th></tr>{cells}</table></div></div>'
    )


def _rank(patch: Patch, has_faults: bool) -> int:
    kind = STATES[patch.state][1]
    return 0 if kind == "lost" else 1 if kind == "waiting" else 2 if has_faults or patch.emcy else 3


def _board_row(patch: Patch, faults: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> str:
    word, kind = STATES[patch.state]
    age = (
        f"{1e3 * patch.age_s:.0f}"
        if patch.age_s < 10.0
        else "&gt; 10 s"
        if patch.last_fresh_ns
        else "&ndash;"
    )
    bad = np.flatnonzero(faults)
    names = "|".join(
        sorted({str(flag.name).lower() for t in bad.tolist() for flag in TactelFault(int(faults[t]))})
    )
    what = f'<span class="lost">{len(bad)} {text(names)}</span>' if len(bad) else "good"
    emcy = f"0x{patch.emcy:04X}" if patch.emcy else ""
    bus = f"{text(patch.bus)} " if patch.bus else ""
    return (
        f'<tr><td class="n">{bus}{patch.node_id}</td><td>{text(patch.link)}</td>'
        f'<td class="{kind}">{word}</td>'
        f'<td class="n">{age}</td><td>{emcy}</td><td>{what}</td></tr>'
    )


def cycle_table(cycle: Cycle, history: History, period_ms: float) -> str:
    """Return what the newest cycle says of itself, and how much of their time its buses are taken."""
    flags = ", ".join(str(flag.name).lower().replace("_", " ") for flag in cycle.flags) or "none"
    latencies = 1e3 * history.latencies()
    late = (
        f"p50 {np.percentile(latencies, 50):.1f}, p99 {np.percentile(latencies, 99):.1f}, "
        f"max {latencies.max():.1f} ms"
        if len(latencies)
        else "&ndash;"
    )
    buses = cycle.layout.buses
    loads: list[tuple[str, object]] = [("bus load", UNKNOWN)]
    if cycle.bus_loads is not None:
        loads = [
            (f"load of bus {name}" if name else "bus load", f"{100.0 * load:.0f} %")
            for name, load in zip(buses, cycle.bus_loads, strict=True)
        ]
    rows = (
        ("level", cycle.level or UNKNOWN),
        ("time for the estimator", _budget(cycle.budget_us)),
        ("flags", flags),
        ("SYNC to contacts", f"{1e3 * cycle.latency_s:.1f} ms of {period_ms:.1f} ms"),
        ("over the last cycles", late),
        *loads,
        ("SYNC", cycle.counter),
    )
    cells = "".join(
        f'<tr><td class="key">{key}</td><td>{value if "&" in str(value) else text(value)}</td></tr>'
        for key, value in rows
    )
    return f'{STYLE}<div class="sb"><table>{cells}</table>{_histogram(latencies, period_ms)}</div>'


def _budget(budget_us: float | None) -> str:
    if budget_us is None:
        return UNKNOWN
    return f"{1e-3 * budget_us:.1f} ms" if math.isfinite(budget_us) else "no limit"


def loads(arm: Arm, cycle: Cycle, loads: Loads) -> str:
    """Return the loads of the arm, of its links and of the boards that are pressed, the largest first."""
    sign = "&ge;&thinsp;" if loads.at_least.any() else ""
    links = "".join(
        f"<tr><td>{text(link.name)}</td>{_load(force, area)}</tr>"
        for link, force, area in zip(
            arm.links, loads.links.force.tolist(), loads.links.area.tolist(), strict=True
        )
    )
    n_pressed = int((loads.patches.force >= LEAST_N).sum())
    pressed = np.argsort(-loads.patches.force, kind="stable")[:n_pressed]
    boards = "".join(
        f"<tr><td>{text(board_name(arm, p))}</td>"
        f"{_load(float(loads.patches.force[p]), float(loads.patches.area[p]), bool(loads.at_least[p]))}</tr>"
        for p in pressed.tolist()
    )
    heads = '<th class="n">N</th><th class="n">cm&sup2;</th>'
    return (
        f'{STYLE}<div class="sb"><div><b>{sign}{loads.force:.1f} N</b> on the arm'
        f"{'' if cycle.readings.valid.any() else ': no readings'}</div>"
        f'<div class="scroll"><table><tr><th>link</th>{heads}</tr>{links}'
        f"<tr><th>board</th>{heads}</tr>{boards}</table></div></div>"
    )


def _load(force: float, area: float, is_least: bool = False) -> str:
    sign = "&ge;&thinsp;" if is_least else ""
    return f'<td class="n">{sign}{force:.1f}</td><td class="n">{1e4 * area:.1f}</td>'


def board_name(arm: Arm, patch: int) -> str:
    """Return how a board is called: its bus, where there are several, its node-ID and its link."""
    placed = arm.patches[patch]
    bus = arm.buses[placed.bus].name
    return f"{bus + ' ' if bus else ''}{placed.node_id} on {arm.links[placed.link].name}"


def _histogram(latencies: Floats, period_ms: float) -> str:
    """Return bars of latencies (ms) from 0 to the period or the longest; beyond the period they are red."""
    if not len(latencies):
        return ""
    end = max(period_ms, float(latencies.max()))
    counts, edges = np.histogram(latencies, N_BINS, (0.0, end))
    heights = np.ceil((len(BARS) - 1) * counts / counts.max()).astype(int).tolist()
    bars = "".join(BARS[height] for height in heights)
    n_in_time = int(np.searchsorted(edges[:-1], period_ms))
    late = f'<span class="lost">{bars[n_in_time:]}</span>' if n_in_time < N_BINS else ""
    return (
        f'<div class="bars">{bars[:n_in_time]}{late}</div><div class="ends key"><span>0</span>'
        f"<span>SYNC to contacts, ms, {len(latencies)} cycles</span><span>{end:.0f}</span></div>"
    )


def badge(word: str, kind: str) -> str:
    """Return a word on a colour."""
    tint = {"good": "#2b8a3e", "waiting": "#e67700", "lost": "#e03131", "idle": "#868e96"}[kind]
    return f'<span class="badge" style="background:{tint}">{text(word)}</span>'


def state_of(
    cycle: Cycle | None, drawing: Drawing | None, has_ended: bool, error: BaseException | None
) -> tuple[str, str]:
    """Return the state of the source in a word or two, and how good that is."""
    if error is not None:
        return f"ended: {error}", "lost"
    if has_ended:
        return "ended", "idle"
    if cycle is None or cycle.number == 0:
        return "waiting for the first cycle", "waiting"
    if drawing is not None and drawing.is_stale:
        return "no cycles: bus or master is gone", "lost"
    if CycleFlags.INCOMPLETE in cycle.flags:
        return "live, boards without readings", "waiting"
    return ("live", "good") if not cycle.flags else ("live, impaired", "waiting")


def head(
    title: str, word: str, kind: str, *, notes: Iterable[str] = (), counts: tuple[int, int, int] = (0, 0, 0)
) -> str:
    """Return the head of the panel; ``counts`` are cycles made, lost on the way here, and drawn."""
    n_made, n_lost, n_drawn = counts
    lines = "".join(f'<div class="waiting">{text(note)}</div>' for note in notes if note)
    lost = f", {n_lost} lost" if n_lost else ""
    return (
        f'{STYLE}<div class="sb"><div><b>{text(title)}</b> {badge(word, kind)}</div>'
        f'<div class="key">{n_made} cycles{lost}, {n_drawn} drawn</div>{lines}</div>'
    )


def recording(path: Path | None, goes_on: bool, n_frames: int, n_marks: int) -> str:
    """Return what is being recorded, or was."""
    if path is None:
        return f'{STYLE}<div class="sb key">nothing is being recorded</div>'
    marks = f", {n_marks} mark{'s' * (n_marks != 1)}"
    what = f"{n_frames} frames{marks}" if goes_on else f"ended{marks}"
    kind = "lost" if goes_on else "idle"
    return f'{STYLE}<div class="sb">{badge("rec" if goes_on else "file", kind)} {text(path)}: {what}</div>'


def playing(number: int, n_cycles: int, is_complete: bool, marks: list[tuple[int, float]]) -> str:
    """Return where a film stands."""
    more = "" if is_complete else ", more are being made"
    where = "".join(f" &middot; mark {n} at {seconds:.2f} s" for n, seconds in marks[-MOST_MARKS:])
    return f'{STYLE}<div class="sb"><span class="key">cycle {number} of {n_cycles}{more}</span>{where}</div>'
