"""A plot as inline SVG: axes with units, lines, bands and points that show their numbers; no library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from skinbus.cli.pages.page import text

WIDTH: Final = 440
HEIGHT: Final = 310
"""Of the whole picture in its own units: on a phone of 390 px its letters have 10 px."""
LEFT, RIGHT, TOP, BOTTOM = 54, 12, 10, 44
MARK: Final = 5.5
"""Radius of a point."""


class Axis:
    """Values to a length, linear or logarithmic, with ticks at round numbers."""

    def __init__(self, low: float, high: float, label: str, *, log: bool = False) -> None:
        if log:
            low, high = max(low, 1e-12), max(high, 1e-12)
            if high <= low * 1.2:
                low, high = low / 1.5, high * 1.5
        elif high <= low:
            low, high = low - 0.5, high + 0.5
        self.low, self.high, self.label, self.log = low, high, label, log

    def at(self, value: float) -> float:
        """Return the place of a value, 0 to 1; beyond the ends it is at the end."""
        if self.log:
            value = math.log(max(value, 1e-300) / self.low) / math.log(self.high / self.low)
        else:
            value = (value - self.low) / (self.high - self.low)
        return min(max(value, 0.0), 1.0)

    def ticks(self) -> list[float]:
        """Return round numbers within the ends."""
        if self.log:
            span = math.log10(self.high / self.low)
            steps = (1.0, 2.0, 5.0) if span < 2.5 else (1.0,)
            decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
            found = [step * 10.0**k for k in decades for step in steps]
        else:
            rough = (self.high - self.low) / 5.0
            unit = 10.0 ** math.floor(math.log10(rough))
            step = next(unit * m for m in (1.0, 2.0, 5.0, 10.0) if unit * m >= rough)
            first = math.ceil(self.low / step - 1e-9)
            found = [step * k for k in range(first, math.floor(self.high / step + 1e-9) + 1)]
        slack = 1e-9 * abs(self.high)
        return [value for value in found if self.low - slack <= value <= self.high + slack]


class Plot:
    """Collects what is drawn, in its order."""

    def __init__(self, x: Axis, y: Axis, title: str) -> None:
        self._x, self._y, self._title = x, y, title
        self._parts: list[str] = []

    def px(self, x: float) -> float:
        """Return where a value of x is."""
        return LEFT + self._x.at(x) * (WIDTH - LEFT - RIGHT)

    def py(self, y: float) -> float:
        """Return where a value of y is."""
        return HEIGHT - BOTTOM - self._y.at(y) * (HEIGHT - BOTTOM - TOP)

    def line(
        self, xs: Sequence[float], ys: Sequence[float], colour: str, *, dash: str = "", width: float = 2
    ) -> None:
        """Draw a line through points; ``colour`` is a name of the page's palette."""
        path = " ".join(f"{self.px(x):.1f},{self.py(y):.1f}" for x, y in zip(xs, ys, strict=True))
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self._parts.append(
            f'<polyline points="{path}" fill="none" stroke="var(--{colour})" stroke-width="{width}"{dashed}/>'
        )

    def band(self, xs: Sequence[float], low: Sequence[float], high: Sequence[float], colour: str) -> None:
        """Fill between two lines."""
        ends = [*zip(xs, high, strict=True), *reversed(list(zip(xs, low, strict=True)))]
        path = " ".join(f"{self.px(x):.1f},{self.py(y):.1f}" for x, y in ends)
        self._parts.append(f'<polygon points="{path}" fill="var(--{colour})" opacity=".18"/>')

    def dots(self, xs: Sequence[float], ys: Sequence[float], colour: str) -> None:
        """Draw many small points that say nothing."""
        path = "".join(f"M{self.px(x):.1f} {self.py(y):.1f}h0" for x, y in zip(xs, ys, strict=True))
        look = f'stroke="var(--{colour})" stroke-width="2.6" stroke-linecap="round" opacity=".5"'
        self._parts.append(f'<path d="{path}" fill="none" {look}/>')

    def disc(self, x: float, y: float, radius: float, share: float, tip: str, words: str = "") -> None:
        """Draw a disc (``radius`` in units of x) from orange (``share`` -1) over none (0) to blue (1)."""
        colour = "blue" if share > 0.0 else "orange"
        amount = round(75 * min(abs(share), 1.0))
        fill = f"color-mix(in srgb,var(--{colour}) {amount}%,var(--bg))"
        r = abs(self.px(x + radius) - self.px(x))
        self._parts.append(
            f'<circle cx="{self.px(x):.1f}" cy="{self.py(y):.1f}" r="{r:.1f}" style="fill:{fill}" '
            f'stroke="var(--line)" tabindex="0" data-tip="{text(tip)}"/>'
        )
        if words:
            look = 'text-anchor="middle" pointer-events="none"'
            self._parts.append(
                f'<text x="{self.px(x):.1f}" y="{self.py(y) + 4:.1f}" {look}>{text(words)}</text>'
            )

    def point(
        self,
        x: float,
        y: float,
        colour: str,
        tip: str,
        *,
        shape: str = "circle",
        hollow: bool = False,
        size: float = MARK,
    ) -> None:
        """Draw a point that shows ``tip`` when it is pointed at."""
        self._parts.append(
            marker(self.px(x), self.py(y), colour, shape=shape, hollow=hollow, size=size, tip=tip)
        )

    def note(
        self, x: float, y: float, words: str, *, dx: float = 0, dy: float = 0, anchor: str = "middle"
    ) -> None:
        """Write words at a place, ``dx`` and ``dy`` away."""
        place = f'x="{self.px(x) + dx:.1f}" y="{self.py(y) + dy:.1f}" text-anchor="{anchor}"'
        self._parts.append(f"<text {place}>{text(words)}</text>")

    def svg(self) -> str:
        """Return the picture."""
        right, foot = WIDTH - RIGHT, HEIGHT - BOTTOM
        out = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{text(self._title)}">']
        for value in self._x.ticks():
            x = self.px(value)
            out.append(f'<line class="gridline" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{foot}"/>')
            out.append(
                f'<g class="tick"><text x="{x:.1f}" y="{foot + 16}" text-anchor="middle">{value:g}</text></g>'
            )
        for value in self._y.ticks():
            y = self.py(value)
            out.append(f'<line class="gridline" x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
            out.append(
                f'<g class="tick"><text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text></g>'
            )
        out.append(f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{right - LEFT}" height="{foot - TOP}"/>')
        middle = 0.5 * (TOP + foot)
        out.append(
            f'<text x="{0.5 * (LEFT + right):.1f}" y="{HEIGHT - 8}" text-anchor="middle">'
            f"{text(self._x.label)}</text>"
        )
        out.append(
            f'<text x="13" y="{middle:.1f}" text-anchor="middle" transform="rotate(-90 13 {middle:.1f})">'
            f"{text(self._y.label)}</text>"
        )
        return "".join([*out, *self._parts, "</svg>"])


def marker(
    x: float,
    y: float,
    colour: str,
    *,
    shape: str = "circle",
    hollow: bool = False,
    size: float = MARK,
    tip: str = "",
) -> str:
    """Return the SVG of a point: circle, square or diamond."""
    fill = "var(--bg)" if hollow else f"var(--{colour})"
    look = f'fill="{fill}" stroke="var(--{colour})" stroke-width="2"'
    look += f' tabindex="0" data-tip="{text(tip)}"' if tip else ""
    if shape == "square":
        half = 0.9 * size
        place = f'x="{x - half:.1f}" y="{y - half:.1f}" width="{2 * half:.1f}" height="{2 * half:.1f}"'
        return f"<rect {place} {look}/>"
    if shape == "diamond":
        path = f"{x:.1f},{y - size:.1f} {x + size:.1f},{y:.1f} {x:.1f},{y + size:.1f} {x - size:.1f},{y:.1f}"
        return f'<polygon points="{path}" {look}/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size:g}" {look}/>'


def legend(*entries: tuple[str, str]) -> str:
    """Return the legend: SVG of each mark (drawn about 8, 8) and its words."""
    items = (f'<span><svg viewBox="0 0 16 16">{mark}</svg>{text(words)}</span>' for mark, words in entries)
    return f'<div class="legend">{"".join(items)}</div>'
