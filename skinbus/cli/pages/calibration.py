"""The page of a calibration: what was learned, the error to expect, outliers and unusual tactels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from skinbus.cli.calibration_text import is_truer
from skinbus.cli.pages.page import card, grid, page, prose, table, text
from skinbus.cli.pages.plot import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Axis, Plot, legend, marker
from skinbus.estimate.calibration import Calibration
from skinbus.estimate.presses import Judgement
from skinbus.estimate.presses.cross_validation import USUAL, HeldOutErrors
from skinbus.estimate.presses.gate import GOOD, pitch
from skinbus.estimate.response import GAIN_SPREAD, WIDTH_SPREAD

Floats = npt.NDArray[np.float64]

FAR = 3.0
"""Standard deviations of healthy tactels from which one is named: 3 of 1000 good ones are."""
MANY_NOISE = 3.0
"""Times the median noise of the board from which a tactel is named."""
USUAL_OUTLIERS = 0.1
"""Part of presses by hand that are usually left out."""
MAX_DOTS = 1500
"""Readings drawn beside the profile: more make it no clearer."""
ENLARGED = 10.0
"""By which deviations are drawn over a board: half a millimetre is then half a pitch."""
LONGEST_MM = 8.0
"""Of a deviation as it is drawn: longer ones hide others."""
MAX_NUMBERS = 25
"""Tactels of a board up to which their discs hold their numbers."""
_ASPECT = (WIDTH - LEFT - RIGHT) / (HEIGHT - BOTTOM - TOP)


def calibration_page(
    arm: str, source: str, judged: Sequence[tuple[Judgement, npt.NDArray[np.intp], str]]
) -> str:
    """Return the page of the boards of an arm.

    source: name of the file of presses
    judged: of each kind of board what came of its presses, their lines in the file, and the verdict as text
    """
    parts = [
        f"<h1>Calibration of {text(arm)}</h1>",
        f'<p class="dim">{sum(len(one.table) for one, _, _ in judged)} presses from {text(source)}</p>',
    ]
    for one, lines, words in judged:
        if len(judged) > 1:
            parts.append(f"<h2>Boards of {one.table.arm.patches[0].patch.n_tactels} tactels</h2>")
        parts.append(_verdict(one, words))
        if one.calibration is None:
            continue
        parts += [_healthy(one, one.calibration), _law(one, one.calibration)]
        parts += [_board(one, one.calibration, p, lines) for p in range(one.table.arm.n_patches)]
        parts.append(_outliers(one, lines))
    return page(f"skinbus: calibration of {arm}", *parts)


def _verdict(one: Judgement, words: str) -> str:
    """Return whether it may be used, and the error to expect."""
    tone, head = ("bad", "Refused") if one.faults else ("good", "Good") if one.is_good else ("warn", "Fair")
    if not one.faults and not is_truer(one):
        tone, head = "warn", "No better than the law that the boards have"
    if math.isfinite(one.place_error):
        head += f": {1e3 * one.place_error:.2f} mm to expect"
    items = "".join(f"<li>{prose(line.strip())}</li>" for line in words.splitlines() if line.strip())
    return f'<div class="verdict {tone}"><div class="big {tone}">{text(head)}</div><ul>{items}</ul></div>'


def _healthy(one: Judgement, learned: Calibration) -> str:
    """Return what was learned beside what healthy boards have."""
    arm = one.table.arm
    odd = [name for p in range(arm.n_patches) for name in _odd(one, learned, p)]
    gain = np.concatenate(
        [learned.gain[arm.tactels_of(p)] / _middle(learned, arm, p) for p in range(arm.n_patches)]
    )
    n_out = len(one.outliers)
    rows = [
        ("spread of gains", f"{100 * gain.std():.1f} %", f"about {100 * GAIN_SPREAD:.0f} %"),
        ("spread of widths", f"{100 * learned.width.std():.1f} %", f"about {100 * WIDTH_SPREAD:.0f} %"),
        ("noise, median", f"{np.median(learned.noise):.0f} Pa", f"{_declared(one):.0f} Pa declared"),
        ("residuals, in units of what was assumed", f"{learned.residual:.2f}", "about 1"),
        ("presses left out", f"{n_out} of {len(one.table)}", f"up to {100 * USUAL_OUTLIERS:.0f} % by hand"),
        ("converged", "yes" if learned.converged else "no", "yes"),
    ]
    if one.errors is not None and one.shipped is not None:
        rows.insert(0, (
            f"error of place ({100 * USUAL:.0f} % of presses not used)",
            f"{1e3 * one.place_error:.2f} mm",
            f"up to {1e3 * GOOD * pitch(one.table):.2f} mm",
        ))  # fmt: skip
        before = f"{1e3 * one.shipped.place(one.kept):.2f} mm"
        rows.insert(1, ("the same with the law that boards had", before, ""))
        if one.table.force is not None:
            rows.insert(2, ("error of force", f"{100 * one.force_error:.1f} %", ""))
    named = f'<p class="warn">Unlike healthy tactels: {text("; ".join(odd))}.</p>' if odd else (
        '<p class="good">No tactel is unlike healthy ones.</p>'
    )  # fmt: skip
    return f"<h2>Against a healthy board</h2>{table(('', 'this', 'healthy boards'), rows)}{named}"


def _odd(one: Judgement, learned: Calibration, p: int) -> list[str]:
    """Return the tactels of a board that are unlike healthy ones."""
    arm = one.table.arm
    here, node = arm.tactels_of(p), arm.node_label(p)
    gain = np.abs(learned.gain[here] / _middle(learned, arm, p) - 1.0) > FAR * GAIN_SPREAD
    width = np.abs(learned.width[here] - 1.0) > FAR * WIDTH_SPREAD
    noise = learned.noise[here] > MANY_NOISE * np.median(learned.noise[here])
    return [
        f"node {node} tactel {k + 1} ({what})"
        for what, column in (("gain", gain), ("width", width), ("noise", noise))
        for k in np.flatnonzero(column).tolist()
    ]


def _middle(learned: Calibration, arm: object, p: int) -> float:
    """Return the median gain of a board."""
    return float(np.median(learned.gain[arm.tactels_of(p)]))  # type: ignore[attr-defined]


def _declared(one: Judgement) -> float:
    return float(np.median(one.table.arm.tactel_noise))


def _law(one: Judgement, learned: Calibration) -> str:
    """Return the profile with its spread, the errors to expect, and forces."""
    law, typical = learned.law, learned.law.typical_force or 1.0
    reach = law.step * (len(law.table) - 1)
    d = np.linspace(0.0, reach, 160)
    k = np.asarray(law.pressure(d, typical)) / typical / 1e3
    spread = law.misfit * k
    if law.misfit_profile is not None:
        effective = float(law.pressure(0.0, typical)) / float(law.profile(0.0))
        at = law.step * np.arange(len(law.table))
        spread = np.interp(d, at, law.misfit_profile) * effective / typical / 1e3
    shipped = one.table.arm.patches[0].patch.law
    before = np.asarray(shipped.pressure(d, typical)) / typical / 1e3
    top = 1.12 * max(float((k + spread).max()), float(before.max()))
    unit = "N" if one.table.force is not None else "unit of force"
    plot = Plot(
        Axis(0.0, 1e3 * reach, "distance from the press, mm"),
        Axis(min(0.0, float((k - spread).min())) - 0.02 * top, top, f"pressure of 1 {unit}, kPa"),
        "profile of the law with its spread",
    )
    plot.dots(*_samples(one, learned, reach), "dim")
    plot.band((1e3 * d).tolist(), (k - spread).tolist(), (k + spread).tolist(), "blue")
    plot.line((1e3 * d).tolist(), before.tolist(), "orange", dash="5 4", width=1.6)
    plot.line((1e3 * d).tolist(), k.tolist(), "blue", width=2.4)
    marks = legend(
        ('<path d="M0 8H16" stroke="var(--blue)" stroke-width="3"/>', "learned, with its standard deviation"),
        ('<path d="M0 8H16" stroke="var(--orange)" stroke-width="2" stroke-dasharray="4 3"/>', "before"),
        (marker(8, 8, "dim", size=2.5), "readings"),
    )
    cards = [card("Profile of the law", marks + plot.svg())]
    if one.errors is not None:
        cards.append(_distribution(one, one.errors))
        if one.table.force is not None and float(np.ptp(one.table.force)) > 0.0:
            cards.append(_forces(one, one.errors))
    return f"<h2>What was learned</h2>{grid(*cards)}"


def _samples(one: Judgement, learned: Calibration, reach: float) -> tuple[list[float], list[float]]:
    """Return distances (mm) and pressures of 1 N (kPa) of some readings, as inputs of the law."""
    arm, pressed = one.table.arm, one.table
    force = np.ones(len(pressed)) if pressed.force is None else pressed.force
    typical = learned.law.typical_force or 1.0
    xs, ys = [], []
    gain = learned.gain / np.asarray(arm.tactel_gain)
    for row in np.flatnonzero(one.kept).tolist():
        here = arm.tactels_of(int(pressed.patch[row]))
        surface = arm.links[int(pressed.link[row])].surface
        d = surface.distance(pressed.s[row], pressed.a[row], arm.tactel_s[here], arm.tactel_a[here])
        scale = (force[row] / typical) ** learned.law.exponent * typical * 1e3
        xs.append(1e3 * np.asarray(d) / learned.width[here])
        ys.append((pressed.pressures[row, here] * gain[here] - learned.bias[here]) / scale)
    x, y = (np.concatenate([*some, np.zeros(0)]) for some in (xs, ys))
    (there,) = np.nonzero(np.isfinite(y) & (x < 1e3 * reach))
    some = there[:: max(1, math.ceil(len(there) / MAX_DOTS))]
    return x[some].tolist(), y[some].tolist()


def _distribution(one: Judgement, errors: HeldOutErrors) -> str:
    """Return which part of the presses has at most which error."""
    curves = [("this calibration", "blue", errors)]
    if one.shipped is not None:
        curves.append(("the law that boards had", "orange", one.shipped))
    sorted_mm = {name: np.sort(1e3 * np.hypot(*some.uv[some.found & one.kept].T)) for name, _, some in curves}
    largest = max([0.1, *(float(np.quantile(mm, 0.98)) for mm in sorted_mm.values() if len(mm))])
    plot = Plot(
        Axis(0.0, largest, "error of place at presses not used, mm"),
        Axis(0.0, 100.0, "part of the presses, %"),
        "cross-validated error",
    )
    plot.line([0.0, largest], [100 * USUAL, 100 * USUAL], "dim", dash="3 4", width=1)
    for name, colour, _ in curves:
        mm = sorted_mm[name]
        if len(mm):
            shares = 100.0 * (np.arange(len(mm)) + 1) / len(mm)
            inside = mm <= largest
            plot.line(mm[inside].tolist(), shares[inside].tolist(), colour)
            usual = float(np.quantile(mm, USUAL))
            tip = f"{name}: {100 * USUAL:.0f} % of the presses within {usual:.2f} mm"
            plot.point(usual, 100 * USUAL, colour, tip)
            plot.note(usual, 100 * USUAL, f"{usual:.2f} mm", dx=9, dy=16, anchor="start")
    entries = [(marker(8, 8, colour, size=5), name) for name, colour, _ in curves]
    return card("Error to expect, by cross-validation", legend(*entries) + plot.svg())


def _forces(one: Judgement, errors: HeldOutErrors) -> str:
    assert one.table.force is not None
    rows = np.flatnonzero(errors.found & one.kept & (errors.force > 0.0))
    said, found = one.table.force[rows], errors.force[rows]
    if not len(rows):
        return ""
    ends = min(float(said.min()), float(found.min())), max(float(said.max()), float(found.max()))
    plot = Plot(
        Axis(0.9 * ends[0], 1.1 * ends[1], "force of the press, N", log=ends[1] > 3 * ends[0]),
        Axis(0.9 * ends[0], 1.1 * ends[1], "force found at presses not used, N", log=ends[1] > 3 * ends[0]),
        "forces",
    )
    plot.line(list(ends), list(ends), "dim", dash="3 4", width=1)
    plot.dots(said.tolist(), found.tolist(), "blue")
    return card(
        "Force, by cross-validation", legend((marker(8, 8, "blue", size=2.5), "a press")) + plot.svg()
    )


def _board(one: Judgement, learned: Calibration, p: int, lines: npt.NDArray[np.intp]) -> str:
    """Return gains, widths and noise of the tactels of a board, and its residuals."""
    arm = one.table.arm
    here, middle = arm.tactels_of(p), _middle(learned, arm, p)
    gain, width, noise = learned.gain[here], learned.width[here], learned.noise[here]
    usual = max(float(np.median(noise)), 1e-9)
    louder = np.log(np.maximum(noise, 1e-9) / usual) / math.log(MANY_NOISE)
    cards = [
        _residuals(one, p, lines),
        _tactels(one, p, "Gain of each tactel", gain, (gain / middle - 1.0) / (FAR * GAIN_SPREAD), "{:.3f}"),
        _tactels(one, p, "Width of each tactel", width, (width - 1.0) / (FAR * WIDTH_SPREAD), "{:.3f}"),
        _tactels(one, p, "Noise of each tactel, Pa", noise, louder, "{:.0f}"),
    ]
    return f"<h2>Board {text(arm.node_label(p))}</h2>{grid(*cards, least=420)}"


def _plane(one: Judgement, p: int, title: str, margin: float) -> Plot:
    """Return the plane of a board, as wide as high in millimetres."""
    width, height = one.table.arm.patches[p].patch.size
    half = 1e3 * (0.5 * max(height, width / _ASPECT) + margin)
    return Plot(
        Axis(-half * _ASPECT, half * _ASPECT, "u, mm"), Axis(-half, half, "v, mm"), f"{title} over the board"
    )


def _outline(plot: Plot, one: Judgement, p: int) -> None:
    u, v = (500.0 * x for x in one.table.arm.patches[p].patch.size)
    plot.line([-u, u, u, -u, -u], [-v, -v, v, v, -v], "dim", width=1)


def _tactels(one: Judgement, p: int, title: str, values: Floats, shares: Floats, form: str) -> str:
    patch = one.table.arm.patches[p].patch
    plot = _plane(one, p, title, 1e-3)
    _outline(plot, one, p)
    for k, ((u, v), value, share) in enumerate(zip(1e3 * patch.tactels_uv, values, shares, strict=True)):
        words = form.format(value)
        tip = f"tactel {k + 1}: {words}"
        plot.disc(
            u, v, 500.0 * patch.diameter, float(share), tip, words if len(values) <= MAX_NUMBERS else ""
        )
    return card(title, plot.svg())


def _residuals(one: Judgement, p: int, lines: npt.NDArray[np.intp]) -> str:
    """Return where presses are found, against where they were, over the board."""
    pressed, errors = one.table, one.errors
    plot = _plane(one, p, "residuals", 6e-3)
    _outline(plot, one, p)
    patch = pressed.arm.patches[p].patch
    for u, v in 1e3 * patch.tactels_uv:
        plot.disc(u, v, 500.0 * patch.diameter, 0.0, "")
    uv = 1e3 * pressed.uv()
    for row in np.flatnonzero(pressed.patch == p).tolist():
        u, v = uv[row].tolist()
        is_out = not one.kept[row]
        words = f"line {lines[row]}: u {u:.1f}, v {v:.1f} mm"
        if pressed.force is not None:
            words += f", {pressed.force[row]:.2f} N"
        off = np.full(2, np.nan) if errors is None else 1e3 * errors.uv[row]
        if np.isfinite(off).all() and not is_out:
            # one that would leave the board is cut, and dashed
            length = ENLARGED * math.hypot(*off)
            drawn = off * ENLARGED * min(1.0, LONGEST_MM / max(length, 1e-9))
            dash = "3 2" if length > LONGEST_MM else ""
            plot.line([u, u + drawn[0]], [v, v + drawn[1]], "blue", width=1.4, dash=dash)
            words += f"\nfound {math.hypot(*off):.2f} mm away"
        words += "\nleft out" if is_out else ""
        shape, colour = ("diamond", "bad") if is_out else ("circle", "blue")
        plot.point(u, v, colour, words, shape=shape, size=5.0 if is_out else 2.2)
    entries = [(marker(8, 8, "blue", size=3), f"press, with its deviation {ENLARGED:g} times as long")]
    if len(one.outliers):
        entries.append((marker(8, 8, "bad", shape="diamond", size=5), "left out"))
    return card("Residuals over the board", legend(*entries) + plot.svg())


def _outliers(one: Judgement, lines: npt.NDArray[np.intp]) -> str:
    """Return the presses that were left out, with their lines in the file."""
    if not len(one.outliers):
        return "<h2>Outliers</h2><p>None: no press deviates far more than the others.</p>"
    pressed, uv = one.table, 1e3 * one.table.uv()
    rows = [
        (
            int(lines[row]),
            pressed.arm.node_label(int(pressed.patch[row])),
            f"{1e3 * pressed.s[row]:.1f}",
            f"{1e3 * pressed.a[row]:.1f}",
            f"{uv[row, 0]:.1f}",
            f"{uv[row, 1]:.1f}",
            "" if pressed.force is None else f"{pressed.force[row]:.2f}",
        )
        for row in one.outliers.tolist()
    ]
    heads = ("line of the file", "node", "s, mm", "a, mm", "u, mm", "v, mm", "force, N")
    return f"<h2>Outliers</h2><p>Left out: they deviate far more than the others.</p>{table(heads, rows)}"
