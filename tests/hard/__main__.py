"""Makes the table and the figure of docs/hard-cases.md anew: ``python -m tests.hard``."""

import math
import sys
from pathlib import Path

from skinbus.estimate import LEVELS
from skinbus.study.draw import COLOURS, new_figure, save
from tests.hard.catalogue import CASES
from tests.hard.curves import FAMILIES, measure_point
from tests.hard.test_catalogue import outcomes_of

PAGE = Path("docs/hard-cases.md")
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
LEVEL = "fit"
PLACE, FORCE = 1e-3, 0.1
"""m and relative: a case that is nearer to the truth everywhere is left out."""
TRIALS = 60


def rows():
    """The cases that a level cannot solve, the worst of surfaces and laws; and what does not hold."""
    table = [
        "case | contacts | place off by, mm | force off by, % | reported sd, mm | flags",
        " | ".join(["---"] * 6),
    ]
    faults = []
    for name in CASES:
        outcomes = outcomes_of(name, LEVEL)
        faults += [f"{name}, {' '.join(g)}: {f}" for g, o in outcomes.items() for f in o.faults]
        found = outcomes.values()
        place, force, sd = (
            float(max(filter(math.isfinite, (getattr(o, key) for o in found)), default=0.0))
            for key in ("place", "force", "sd")
        )
        if place > PLACE or force > FORCE:
            counts = sorted(o.n for o in found)
            row = name, "–".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
            numbers = (
                f"{1e3 * place:.2g}" * (place > 1e-6),
                f"{100 * force:.3g}" * (force > 1e-3),
                f"{1e3 * sd:.2g}" * (sd > 0.0),
            )
            flags = ", ".join(sorted({q.name for o in found for q in o.quality}))
            table.append(" | ".join((*row, *numbers, flags)))
    return table, faults


def draw():
    """Error and reported standard deviation as each family gets harder."""
    figure, panels = new_figure(len(FAMILIES), width=4.3, height=3.8)
    for axes, (family, (title, hardnesses, _)) in zip(panels[0], FAMILIES.items(), strict=True):
        for level in LEVELS:
            points = [measure_point(family, level, x, TRIALS, 1) for x in hardnesses]
            x = [1e3 * hardness for hardness in hardnesses]
            axes.plot(
                x, [p.error_mm for p in points], "o-", color=COLOURS[level], ms=4, label=f"{level}: error"
            )
            if level != LEVELS[0]:
                axes.plot(
                    x, [p.sigma_mm for p in points], "--", color=COLOURS[level], label=f"{level}: reported"
                )
        axes.set(xscale="log" if family == "line" else "linear", yscale="log", xlabel=title)
        axes.set_ylabel("position, root mean square (mm)")
    panels[0][0].legend(fontsize=7)
    save(figure, PAGE.parent / "figures" / "hard-curves.svg")


table, faults = rows()
text = "".join(f"| {row} |\n" for row in table)
before, rest = PAGE.read_text().split(BEGIN)
PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n{END}{rest.split(END)[1]}")
draw()
sys.exit("\n".join(faults) or None)
