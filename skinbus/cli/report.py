"""Reports to look at in a browser: text, tables and matplotlib's SVG in one file that fetches nothing."""

from __future__ import annotations

import io
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Final

from skinbus.printable import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE: Final = """
body{margin:0 auto;max-width:1240px;padding:1rem;font:15px/1.5 system-ui,sans-serif;
color:#1b1f24;background:#fff}
svg{display:block;max-width:100%;height:auto}
div{overflow-x:auto}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}
th,td{padding:4px 10px;text-align:left;border-bottom:1px solid #d0d7de}
"""


class Report:
    """A page of paragraphs, tables and figures, in the order in which they are added."""

    def __init__(self, title: str) -> None:
        self._title = _text(title)
        self._parts = [f"<h1>{self._title}</h1>"]

    def heading(self, text: str) -> None:
        """Begin a section."""
        self._parts.append(f"<h2>{_text(text)}</h2>")

    def paragraph(self, text: str) -> None:
        """Add a paragraph; its line breaks are kept."""
        self._parts.append(f"<p>{_text(text)}</p>".replace("\n", "<br>"))

    def table(self, titles: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """Add a table with the titles of its columns."""
        head = "".join(f"<th>{_text(cell)}</th>" for cell in titles)
        body = "".join(f"<tr>{''.join(f'<td>{_text(cell)}</td>' for cell in row)}</tr>\n" for row in rows)
        self._parts.append(f"<div><table><tr>{head}</tr>\n{body}</table></div>")

    def figure(self, figure: Figure) -> None:
        """Add a figure as SVG; the same figure gives the same text."""
        from skinbus.study.draw import write_svg

        svg = io.StringIO()
        write_svg(figure, svg)
        self._parts.append("<svg" + svg.getvalue().split("<svg", 1)[1])

    def write(self, file: Path) -> None:
        """Write the page."""
        body = "\n".join(self._parts)
        file.write_text(
            f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{self._title}</title>\n'
            '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
            '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
            "style-src 'unsafe-inline'; img-src data:\">\n"
            f"<style>{_STYLE}</style></head><body>\n{body}\n</body></html>\n",
            encoding="utf-8",
        )


def _text(value: object) -> str:
    """Return text, anybody's, as HTML."""
    return escape(printable(value, keep="\n", limit=None))
