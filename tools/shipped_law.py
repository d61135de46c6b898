"""The law that boards ship with: `python -m tools.shipped_law eds/skin-patch*.eds` learns and writes it.

Boards under one layer of rubber have one law, up to their gains and what presses them. So the EDS of a board
holds a radial law learned from simulated presses of fingertips on the layer of 6 mm, on that very board with
gains of 1, and what fingertips differ by as its misfit. A calibration of the board itself replaces it.
"""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from skinbus.estimate import learn_radial_law
from skinbus.model import Arm, Link, Patch, PlacedPatch, Radial, Surface
from skinbus.objects.board import calibration_values, describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads

DISCS: Final = (0.010, 0.012, 0.015)
"""Diameters of fingertips, m."""
PRESSES: Final = 400
"""By each, all over the board."""
FORCE: Final = 10.0
"""N; the layer is linear, so one force is enough."""
NOISE: Final = 200.0
"""Pa, of a reading; whatever the bits of a board, its law is one."""
SEED: Final = 1


def generic_law(patch: Patch) -> Radial:
    """Return the law of a board under the usual layer."""
    width, height = patch.size
    link = Link("board", Surface.plane(width, height))
    arm = Arm("board", [link], [PlacedPatch(patch=patch, node_id=1, link=0, s=0.5 * width, a=0.0)])
    layer = Elastic()
    law = layer.bind(Geometry.of(arm, discs=layer.discs), [Indenter(Shape.DISC, d) for d in DISCS])
    rng = np.random.default_rng(SEED)
    n = PRESSES * len(DISCS)
    places = np.column_stack([rng.uniform(0.0, width, n), rng.uniform(-0.5 * height, 0.5 * height, n)])
    pressures = NOISE * rng.standard_normal((n, arm.n_tactels))
    for k, (row, (s, a)) in enumerate(zip(pressures, places, strict=True)):
        law.add(Loads(1, s=s, a=a, force=FORCE, indenter=k % len(DISCS)), row)
    learned = learn_radial_law(arm, places[:, 0], places[:, 1], np.full(n, FORCE), pressures).law
    # what fingertips differ by scales with the pressure; presses here are all of one force
    return replace(learned, misfit_profile=None, typical_force=0.0)


def write_generic_law(eds: Path) -> Radial:
    """Write the law of an EDS's own board to its defaults; return the law."""
    od = load_eds(eds, 1)
    law, text = generic_law(describe_patch(od, str(eds))), eds.read_text()
    for (index, sub), value in calibration_values(od, law=law, gain=[], noise=[]).items():
        if isinstance(value, int | float):
            default = str(value if isinstance(value, int) else np.float32(value))
            section = rf"(?si)(\[{index:04X}sub{sub:X}\][^\[]*?\nDefaultValue=)[^\r\n]*"
            text, found = re.subn(section, rf"\g<1>{default}", text)
            if found != 1:
                raise SystemExit(f"{eds}: no DefaultValue of {index:04X}sub{sub:X}")
    eds.write_text(text)
    return law


if __name__ == "__main__":
    for file in map(Path, sys.argv[1:]):
        found = write_generic_law(file)
        print(f"{file}: k(0) {found.table[0]:.0f} 1/m^2, misfit {100 * found.misfit:.1f} %")
