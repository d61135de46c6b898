"""A bus without wire time: cores hand each other frames at once, so that only computing takes time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.can.core import Core, DataQueue
from skinbus.can.frame import Frame
from skinbus.master import CycleReport, Master
from skinbus.model import Arm
from skinbus.sim import Scene, Touch, World
from skinbus.sim.laws import Elastic


def run_instantly(first: Core, second: Core, is_over: Callable[[], bool]) -> int:
    """Let two cores talk until ``is_over`` says so; return the bus time that has passed, ns."""
    now_ns = 0
    cores = (first, second)
    queues = [DataQueue(core) for core in cores]
    waiting: list[list[Frame]] = [[], []]
    wakes = [0, 0]
    while not is_over():
        for k, core in enumerate(cores):
            if waiting[k] or wakes[k] <= now_ns:
                received, waiting[k] = waiting[k], []
                wanted = core.cob_ids
                data_ids = core.data_ids_on(0)
                for frame in received:
                    if frame.can_id in data_ids and queues[k].append(frame):
                        queues[k].pass_on(now_ns)
                queues[k].pass_on(now_ns)
                frames = [
                    f for f in received if f.can_id not in data_ids and (wanted is None or f.can_id in wanted)
                ]
                answer = core.step(now_ns, frames)
                waiting[1 - k] += [f._replace(t_ns=now_ns) for f in answer.frames]
                wakes[k] = answer.wake_ns
        if not (waiting[0] or waiting[1]):
            now_ns = max(now_ns + 1, min(wakes))
    return now_ns


def press(arm: Arm, n_touches: int, *, duration_s: float = 3600.0, force: float = 6.0) -> Scene:
    """Return a scene in which points press on patches all over an arm, away from their centres."""
    step = max(1, arm.n_patches // max(1, n_touches))
    touches = []
    for k in range(min(n_touches, arm.n_patches)):
        patch = arm.patches[k * step]
        path = np.array([[0.0, patch.s + 0.007, patch.a - 0.004]])
        keys = np.array([[0.0, force], [duration_s, force]])
        touches.append(Touch(link=patch.link, path=path, force=keys))
    return Scene("press", arm, duration_s=duration_s, layer=Elastic(), touches=touches)


def time_cycles(
    arm: Arm, level: str, *, stopwatch: Callable[[], int], n_contacts: int = 5, cycles: int = 120
) -> list[int]:
    """Return the compute times of a master's cycles on this machine, ns: gather, estimate, publish."""
    reports: list[CycleReport] = []
    master = Master(arm, level=level, stopwatch=stopwatch, on_cycle=reports.append)
    world = World(press(arm, n_contacts))
    run_instantly(master, world, lambda: len(reports) >= 2 * cycles)
    # The first cycles find patches still booting.
    return [report.compute_ns for report in reports[cycles:] if report.n_fresh == arm.n_patches]
