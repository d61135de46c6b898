"""Times the cycles of a master beside simulated patches: only its computing counts, not the wire."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.can.virtual_buses import VirtualBuses
from skinbus.config.system import ods_of
from skinbus.master import CycleReport, Master
from skinbus.model import Arm
from skinbus.sim import Scene, Touch, World
from skinbus.sim.laws import Elastic

DURATION_S = 3600.0
FORCE = 6.0
"""N, of each of the points that press."""


def press(arm: Arm, n_touches: int) -> Scene:
    """Return a scene in which points press on patches all over an arm, away from their centres."""
    step = max(1, arm.n_patches // max(1, n_touches))
    touches = []
    for patch in arm.patches[::step][:n_touches]:
        path = np.array([[0.0, patch.s + 0.007, patch.a - 0.004]])
        touches.append(Touch(link=patch.link, path=path, force=np.array([[0.0, FORCE], [DURATION_S, FORCE]])))
    return Scene("press", arm, duration_s=DURATION_S, layer=Elastic(), touches=touches)


def time_cycles(
    arm: Arm, level: str, *, stopwatch: Callable[[], int], n_contacts: int = 5, cycles: int = 120
) -> list[int]:
    """Return the compute times of a master's cycles on this machine, ns: gather, estimate, publish."""
    reports: list[CycleReport] = []
    wires = VirtualBuses(
        [bus.bitrate for bus in arm.buses], data_bitrates=[bus.data_bitrate for bus in arm.buses]
    )
    wires.attach(World(press(arm, n_contacts), ods_of(arm)))
    wires.attach(Master(arm, level=level, stopwatch=stopwatch, on_cycle=reports.append))
    # patches boot in the first cycles
    wires.run(round(2e9 * cycles / arm.bus.rate_hz))
    return [report.compute_ns for report in reports[-cycles:] if report.n_fresh == arm.n_patches]
