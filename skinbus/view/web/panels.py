"""The panels of the page as text: what the cycle, the boards and the source are doing; escaped for HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

from skinbus.model import Arm
from skinbus.printable import printable
from skinbus.skin.cycle import Cycle, CycleFlags, PatchState, TactelFault
from skinbus.skin.pressed import Loads
from skinbus.view.web import colours
from skinbus.view.web.follower import Follower

STATES = {
    PatchState.UNUSED: ("not in the arm file", "lost"),
    PatchState.ABSENT: ("absent", "lost"),
    PatchState.BOOTING: ("booting", "waiting"),
    PatchState.WRONG: ("wrong device", "lost"),
    PatchState.OPERATIONAL: ("operational", "good"),
    PatchState.SILENT: ("silent", "lost"),
}
UNKNOWN = "not known from here"
SLOW = 0.95
"""Pace of a simulation below which the page says that it is slow."""
STYLE = """<style>
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
.sb .scroll{max-height:34em;overflow:auto}
</style>"""


def text(value: object) -> str:
    """Return what strangers wrote, fit for HTML."""
    return escape(printable(str(value)))


def panel(content: str) -> str:
    """Return a panel with its style."""
    return f'{STYLE}<div class="sb">{content}</div>'


def table(rows: Iterable[Sequence[str]], classes: Sequence[str]) -> str:
    """Return rows of cells that are HTML; ``classes`` are those of the columns."""
    lines = (
        "".join(f'<td class="{kind}">{cell}</td>' for kind, cell in zip(classes, row, strict=True))
        for row in rows
    )
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def legend(full_kpa: float = colours.FULL_KPA) -> str:
    """Return the legend of pressures and marks."""
    ticks = "".join(f"<span>{full_kpa * k / 4:g}</span>" for k in range(5))
    marks = "".join(
        f'<span><span style="color:rgb{colour}">{sign}</span> {name}</span>'
        for sign, colour, name in (
            ("&#10140;", colours.CONTACT, "contact &plusmn; 3&sigma;"),
            ("&#10140;", colours.TRUTH, "truth"),
            ("&#10005;", colours.LOST, "lost or bad"),
            ("&#9679;", colours.UNKNOWN, "no reading"),
        )
    )
    return panel(
        f'<div class="bar" style="background:{colours.gradient()}"></div><div class="ends">{ticks}</div>'
        f'<div class="key">pressure, kPa</div><div class="marks">{marks}</div>'
    )


def boards(cycle: Cycle, arm: Arm, loads: Loads) -> str:
    """Return health and load of every board, those that need attention first."""
    rows = []
    for number, patch in enumerate(cycle.patches):
        word, kind = STATES[patch.state]
        age = f"{1e3 * patch.age_s:.0f}" if patch.age_s < 10.0 else "&gt; 10 s"
        faults = cycle.readings.faults[arm.tactels_of(number)]
        bad = faults[faults != 0].tolist()
        names = "|".join(sorted({str(flag.name).lower() for fault in bad for flag in TactelFault(fault)}))
        rank = ("lost", "waiting").index(kind) if kind != "good" else 2 if bad or patch.emcy else 3
        cells = (
            text(board_name(arm, number)),
            f'<span class="{kind}">{word}</span>',
            age if patch.last_fresh_ns else "&ndash;",
            f"0x{patch.emcy:04X}" if patch.emcy else "",
            f'<span class="lost">{len(bad)} {text(names)}</span>' if bad else "good",
            f"{'&ge;' if loads.at_least[number] else ''}{loads.patches.force[number]:.1f}",
        )
        rows.append((rank, number, cells))
    n_good = sum(patch.state is PatchState.OPERATIONAL for patch in cycle.patches)
    heads = ("node", "state", "ms", "EMCY", "tactels", "N")
    shown = table([heads, *(cells for _, _, cells in sorted(rows))], ("", "", "n", "", "", "n"))
    each = ", ".join(
        f"{text(link.name)} {force:.1f} N"
        for link, force in zip(arm.links, loads.links.force.tolist(), strict=True)
        if force
    )
    return panel(
        f"<div>{n_good} of {len(rows)} boards operational</div><div>load {loads.force:.1f} N"
        f'{": " + each if each else ""}</div><div class="scroll">{shown}</div>'
    )


def board_name(arm: Arm, patch: int) -> str:
    """Return how a board is called: its bus, where there are several, its node-ID and its link."""
    placed = arm.patches[patch]
    bus = arm.buses[placed.bus].name
    return f"{bus + ' ' if bus else ''}{placed.node_id} on {arm.links[placed.link].name}"


def cycle_table(cycle: Cycle, period_ms: float) -> str:
    """Return what the newest cycle says of itself."""
    budget_us = cycle.budget_us
    budget = UNKNOWN if budget_us is None else f"{1e-3 * budget_us:.1f} ms"
    rows = {
        "level": cycle.level or UNKNOWN,
        "time for the estimator": "no limit" if budget_us == math.inf else budget,
        "flags": ", ".join(str(flag.name).lower().replace("_", " ") for flag in cycle.flags) or "none",
        "SYNC to contacts": f"{1e3 * cycle.latency_s:.1f} ms of {period_ms:.1f} ms",
        "SYNC": str(cycle.counter),
    }
    return panel(table(rows.items(), ("key", "")))


def head(
    title: str,
    source: Follower,
    cycle: Cycle | None,
    *,
    is_stale: bool,
    n_drawn: int,
    notes: Iterable[str],
) -> str:
    """Return the head of the panel: the source, its state, and how many cycles were made, lost and drawn."""
    word, kind = state_of(source, cycle, is_stale=is_stale)
    tint = {"good": "#2b8a3e", "waiting": "#e67700", "lost": "#e03131", "idle": "#868e96"}[kind]
    badge = f'<span class="badge" style="background:{tint}">{text(word)}</span>'
    lines = "".join(f'<div class="waiting">{text(note)}</div>' for note in notes if note)
    lost = f", {source.n_lost} lost" if source.n_lost else ""
    return panel(
        f"<div><b>{text(title)}</b> {badge}</div>"
        f'<div class="key">{source.n_cycles + source.n_lost} cycles{lost}, {n_drawn} drawn</div>{lines}'
    )


def state_of(source: Follower, cycle: Cycle | None, *, is_stale: bool) -> tuple[str, str]:
    """Return the state of the source in a word or two, and how good that is."""
    if source.error is not None:
        return f"ended: {source.error}", "lost"
    if source.has_ended:
        return "ended", "idle"
    if cycle is None or cycle.number == 0:
        return "waiting for the first cycle", "waiting"
    if is_stale:
        return source.gone, "lost"
    if source.pace < SLOW:
        return f"slow: {source.pace:.2g} of real time", "waiting"
    if CycleFlags.INCOMPLETE in cycle.flags:
        return "live, boards without readings", "waiting"
    return ("live", "good") if not cycle.flags else ("live, impaired", "waiting")
