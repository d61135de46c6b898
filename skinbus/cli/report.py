"""Reports to look at in a browser: text, tables and matplotlib's SVG in one file that fetches nothing."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import Any, Final

from skinbus.errors import SkinbusError
from skinbus.printable import printable

PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta name="viewport" content="width=device-width,initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; \
style-src 'unsafe-inline'; img-src data:">
<style>
body{{margin:0 auto;max-width:1240px;padding:1rem;font:15px/1.5 system-ui,sans-serif;\
color:#1b1f24;background:#fff}}
svg{{display:block;max-width:100%;height:auto}}
div{{overflow-x:auto}}
p{{white-space:pre-line}}
table{{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}}
td{{padding:4px 10px;text-align:left;border-bottom:1px solid #d0d7de}}
</style></head><body>
<h1>{title}</h1>
{body}
</body></html>
"""


@contextmanager
def figures_wanted() -> Iterator[None]:
    """Turn a missing matplotlib into one clear message."""
    try:
        yield
    except ImportError as error:
        raise SkinbusError(f"figures need matplotlib ({error}); pip install 'skinbus[figures]'") from error


def write_page(file: Path, title: str, sections: Iterable[tuple[str, Any]]) -> None:
    """Write a page.

    sections: heading, and a text, the rows of a table below one of titles, or a figure; the same sections
        give the same page
    """
    from skinbus.study.draw import write_svg

    parts = []
    for heading, content in sections:
        parts += [f"<h2>{_text(heading)}</h2>"] if heading else []
        if isinstance(content, str):
            parts.append(f"<p>{_text(content)}</p>")
        elif isinstance(content, list):
            rows = ["<tr>" + "".join(f"<td>{_text(cell)}</td>" for cell in row) + "</tr>" for row in content]
            parts += ["<div><table>", *rows, "</table></div>"]
        else:
            write_svg(content, svg := io.StringIO())
            parts.append("<svg" + svg.getvalue().split("<svg", 1)[1])
    file.write_text(PAGE.format(title=_text(title), body="\n".join(parts)), encoding="utf-8")


def _text(value: object) -> str:
    """Return text, anybody's, as HTML."""
    return escape(printable(value, keep="\n", limit=None))
