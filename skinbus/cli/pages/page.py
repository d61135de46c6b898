"""What all pages share: one look, light and dark, tables, and numbers that points show when pointed at."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from typing import Final

from skinbus.printable import printable

_STYLE: Final = """
:root{color-scheme:light dark;--bg:#fff;--fg:#1b1f24;--dim:#57606a;--line:#d0d7de;--grid:#e6eaee;
--card:#f6f8fa;--orange:#c77700;--blue:#0072b2;--green:#00805e;--purple:#a84a85;--good:#00805e;--warn:#b35900;--bad:#c0392b}
@media(prefers-color-scheme:dark){:root{--bg:#14181d;--fg:#e6e9ec;--dim:#9aa4af;--line:#3a424b;--grid:#262d34;
--card:#1c2228;--orange:#f0a93b;--blue:#5ab4ec;--green:#3fcfa4;--purple:#e08fc0;--good:#3fcfa4;--warn:#f0a93b;
--bad:#ff7b6b}}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1240px;padding:1.2rem 1rem 3rem;background:var(--bg);color:var(--fg);
font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif}
h1{font-size:1.5rem;line-height:1.25;margin:.2rem 0}h2{font-size:1.12rem;margin:1.8rem 0 .5rem}
h3{font-size:.95rem;margin:0 0 .3rem;font-weight:600}p{margin:.4rem 0;max-width:75ch}.dim{color:var(--dim)}
code{font-family:ui-monospace,SFMono-Regular,Menlo,monospace;font-size:.92em}
.grid{display:grid;gap:14px;
grid-template-columns:repeat(auto-fit,minmax(min(100%,var(--least,330px)),1fr))}
.card{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:12px 14px;min-width:0}
.big{font-size:1.35rem;font-weight:650;line-height:1.25}.good{color:var(--good)}.warn{color:var(--warn)}
.bad{color:var(--bad)}
.verdict{border-left:5px solid var(--tone);padding:10px 14px;background:var(--card);border-radius:6px;
margin:.8rem 0}
.verdict.good{--tone:var(--good)}.verdict.warn{--tone:var(--warn)}.verdict.bad{--tone:var(--bad)}
.verdict p,.verdict li{color:var(--fg)}.verdict ul{margin:.3rem 0;padding-left:1.2rem}
svg{display:block;width:100%;height:auto;max-width:640px;margin:0 auto;overflow:visible}
svg text{fill:var(--fg);font:12px system-ui,-apple-system,"Segoe UI",Roboto,Arial,sans-serif}
svg .tick text,svg text.dim{fill:var(--dim)}svg .gridline{stroke:var(--grid)}
svg .frame{fill:none;stroke:var(--line)}svg [data-tip]{cursor:pointer;outline:none}
svg [data-tip]:hover,svg [data-tip]:focus{stroke:var(--fg);stroke-width:2.5}
.legend{display:flex;flex-wrap:wrap;gap:4px 18px;margin:.4rem 0 .6rem;font-size:.88rem}
.legend svg{width:16px;height:16px;max-width:16px;display:inline-block;vertical-align:-3px;margin:0 5px 0 0}
.scroll{overflow-x:auto;-webkit-overflow-scrolling:touch}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums;width:100%}
th,td{padding:4px 10px;text-align:right;border-bottom:1px solid var(--grid);white-space:nowrap}
th{color:var(--dim);font-weight:600;position:sticky;top:0;background:var(--bg)}
th:first-child,td:first-child{text-align:left;white-space:normal;min-width:7em}tr.chosen td{font-weight:650}
#tip{position:fixed;z-index:9;pointer-events:none;background:var(--fg);color:var(--bg);padding:7px 10px;
border-radius:6px;font-size:13px;line-height:1.4;white-space:pre-line;max-width:min(320px,92vw);opacity:0}
"""

_SCRIPT: Final = """
const tip=document.getElementById('tip');
function show(e){const t=e.target.closest&&e.target.closest('[data-tip]');if(!t){tip.style.opacity=0;return}
tip.textContent=t.dataset.tip;const b=t.getBoundingClientRect(),w=tip.offsetWidth,h=tip.offsetHeight;
tip.style.left=Math.max(6,Math.min(innerWidth-w-6,b.left+b.width/2-w/2))+'px';
tip.style.top=(b.top>h+12?b.top-h-8:b.bottom+8)+'px';tip.style.opacity=.96}
for(const k of ['pointerover','focusin','click'])document.addEventListener(k,show);
document.addEventListener('scroll',()=>tip.style.opacity=0,true);
"""


def page(title: str, *parts: str) -> str:
    """Return a whole page; ``parts`` are HTML."""
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{text(title)}</title>\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n"
        f'<style>{_STYLE}</style></head><body>\n{body}\n<div id="tip" role="status"></div>\n'
        f"<script>{_SCRIPT}</script></body></html>\n"
    )


def text(value: object) -> str:
    """Return text, anybody's, as HTML."""
    return escape(printable(value, keep="\n"))


def prose(value: object) -> str:
    """Return text as HTML in which what stands between backticks is code."""
    return re.sub("`([^`]+)`", r"<code>\1</code>", text(value))


def table(heads: Sequence[str], rows: Sequence[Sequence[object]], chosen: Sequence[int] = ()) -> str:
    """Return a table that scrolls by itself; rows whose numbers are in ``chosen`` are bold."""
    head = "".join(f"<th>{text(cell)}</th>" for cell in heads)
    lines = []
    for k, row in enumerate(rows):
        mark = ' class="chosen"' if k in chosen else ""
        lines.append(f"<tr{mark}>{''.join(f'<td>{text(cell)}</td>' for cell in row)}</tr>")
    head, body = f"<thead><tr>{head}</tr></thead>", "".join(lines)
    return f'<div class="scroll"><table>{head}<tbody>{body}</tbody></table></div>'


def card(title: str, content: str) -> str:
    """Return a box with a title; ``content`` is HTML."""
    return f'<div class="card"><h3>{text(title)}</h3>{content}</div>'


def grid(*cards: str, least: int = 330) -> str:
    """Return boxes beside each other, of ``least`` px at least, below each other on a phone."""
    return f'<div class="grid" style="--least:{least}px">{"".join(cards)}</div>'
