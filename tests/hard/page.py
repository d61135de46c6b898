"""The table of docs/hard-cases.md: cases that ``fit`` cannot solve, the worst of surfaces and laws."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tests.hard.check import Outcome, run_case
from tests.hard.ground import LAWS, SURFACES, Ground
from tests.hard.test_catalogue import CASES

LEVEL = "fit"
PLACE = 1e-3
FORCE = 0.1
"""m and relative: a case that is nearer to the truth everywhere is left out."""


def case_table() -> tuple[str, list[str]]:
    """Return the table as Markdown, and what does not hold."""
    rows = [
        ["case", "contacts", "place off by, mm", "force off by, %", "reported sd, mm", "flags"],
        ["---"] * 6,
    ]
    faults = []
    for case in CASES:
        outcomes = []
        for ground in (Ground(surface, law) for surface in SURFACES for law in LAWS):
            if (outcome := run_case(case, ground, LEVEL)) is not None:
                outcomes.append(outcome)
                faults += [f"{case.name}, {ground.surface}, {ground.law}: {f}" for f in outcome.faults]
        place, force = (_largest([getattr(o, name) for o in outcomes]) for name in ("place", "force"))
        if place > PLACE or force > FORCE:
            rows.append([case.name, *_cells(outcomes, place, force)])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n", faults


def _cells(outcomes: Sequence[Outcome], place: float, force: float) -> list[str]:
    counts = sorted({o.n for o in outcomes})
    sd = max(o.sigma_place for o in outcomes)
    flags = sorted({flag.name or "" for o in outcomes for flag in o.quality})
    return [
        "–".join(str(n) for n in dict.fromkeys((counts[0], counts[-1]))),
        f"{1e3 * place:.2g}" if place > 1e-6 else "",
        f"{100 * force:.3g}" if force > 1e-3 else "",
        f"{1e3 * sd:.2g}" if sd else "",
        ", ".join(flags),
    ]


def _largest(values: Sequence[float]) -> float:
    return max((v for v in values if math.isfinite(v)), default=0.0)
