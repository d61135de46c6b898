"""`skinbus demo`: simulated patches and a master on a virtual clock, contacts live beside the truth."""

from __future__ import annotations

import time
from collections import deque
from contextlib import nullcontext
from typing import Final

import click
import numpy as np
from rich.live import Live
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.host import REFRESH_S, compiling
from skinbus.cli.live import Screen
from skinbus.cli.options import level_option
from skinbus.cli.stop_signals import Ending
from skinbus.estimate import TrackState
from skinbus.sim import load_scene
from skinbus.skin.contact import Level
from skinbus.skin.cycle import Cycle
from skinbus.skin.simulated import simulate
from skinbus.study.arm_study import GATE

UNTOUCHED_S: Final = 0.5
"""A scene that nothing touches at this time has its patches zeroed: all patches have booted by then."""
SETTLE: Final = 3
"""Cycles before and after one in which no touch begins, ends or changes force: the truth is steady."""
STEADY_CHANGE: Final = 0.1
"""By this share a force may change in that time: a stroke is steady, putting a finger down is not."""
GOOD_FORCE_PCT: Final = 20.0
"""A law that was learned with another finger has at least this error."""


@click.command()
@click.argument("scene", default="forearm")
@level_option()
def command(scene: str, level: Level) -> None:
    """Show the whole pipeline in one process: simulated patches, CAN buses, the master, contacts and truth.

    Bus and patches run on a virtual clock, so every machine gets the same contacts. In a terminal the
    scene is played in real time.

    \b
    Examples:
      skinbus demo
      skinbus demo arm --level full
    """
    played = load_scene(scene)
    console, score = Console(), Score()
    with compiling(console):
        skin = simulate(played, level=level, zero=not len(played.touches_at(UNTOUCHED_S).touch))
    patches = counted(played.arm.n_patches, "patch")
    console.print(f"{played.name}: {patches} at {played.arm.bus.rate_hz:g} Hz, {played.duration_s:g} s")
    screen, begin, shown_s = Screen(played.arm), time.monotonic(), 0.0
    live = Live(console=console, auto_refresh=False) if console.is_terminal else nullcontext()
    with Ending() as ending, skin, live as shown:
        for cycle in skin:
            score.add(cycle)
            t_s = 1e-9 * cycle.t_ns
            if shown and t_s >= shown_s + REFRESH_S:
                shown_s = t_s
                shown.update(screen.render(cycle, *console.size), refresh=True)
                time.sleep(max(0.0, begin + t_s - time.monotonic()))
            if ending.asked:
                break
    (place, worst_place), (force, worst_force) = score.spread()
    console.print(
        f"{counted(score.n_cycles, 'cycle')}; errors, median and 95 %: place {place} and {worst_place} mm, "
        f"force {force} and {worst_force} %",
        soft_wrap=True,
    )
    console.print(verdict(score), soft_wrap=True)


class Score:
    """Holds contacts against the truth, in cycles in which that is steady and all patches have answered."""

    def __init__(self) -> None:
        self.n_cycles = self.n_touches = self.n_found = self.n_false = 0
        self._errors: list[tuple[float, float]] = []
        self.last: deque[Cycle] = deque(maxlen=2 * SETTLE + 1)

    def add(self, cycle: Cycle) -> None:
        """Take the next cycle, and judge the one in the middle of the last ones."""
        self.n_cycles += 1
        self.last.append(cycle)
        judged = self.last[len(self.last) // 2]
        first, *others = (np.array([touch.force for touch in one.truth]) for one in self.last)
        is_steady = all(
            other.shape == first.shape and np.allclose(other, first, rtol=STEADY_CHANGE) for other in others
        )
        if (
            len(self.last) <= 2 * SETTLE
            or not is_steady
            or (judged.patch_records["last_fresh_ns"] < judged.t_ns).any()
        ):
            return
        touches = judged.truth
        contacts = [one for one in judged.contacts if one.state not in (TrackState.COAST, TrackState.LIFT)]
        self.n_touches += len(touches)
        if not (touches and contacts):
            self.n_false += len(contacts)
            return
        d = cdist([touch.point for touch in touches], [contact.point for contact in contacts])
        d[np.not_equal.outer([touch.link for touch in touches], [one.link for one in contacts])] = np.inf
        # Outside the gate every distance is equally bad: such pairs are dropped after the assignment.
        pairs = zip(*linear_sum_assignment(np.minimum(d, 10.0 * GATE)), strict=True)
        near = [(t, c) for t, c in pairs if d[t, c] <= GATE]
        self.n_found += len(near)
        self.n_false += len(contacts) - len(near)
        self._errors += [
            (1e3 * d[t, c], 100.0 * abs(contacts[c].force / touches[t].force - 1)) for t, c in near
        ]

    def spread(self) -> list[list[float]]:
        """Return median and 95th percentile of errors of places, mm, and of forces, %."""
        both = np.percentile(self._errors or [(np.nan, np.nan)], (50, 95), axis=0).T
        return [[round(x, 2) for x in one] for one in both.tolist()]


def verdict(score: Score) -> str:
    """Return whether this is good, and what to do if not."""
    missed, force = score.n_touches - score.n_found, score.spread()[1][1]
    if not score.n_touches:
        return "No touch was measured: the scene has none that lasts."
    said = "Every touch was found and no contact was false."
    if missed or score.n_false:
        said = (
            f"{missed} of {score.n_touches} touches in cycles missed, "
            f"{counted(score.n_false, 'contact')} false: touches closer than two pitches need --level full "
            "and a calibrated law, and bare skin shows none (`skinbus view` shows where they are)."
        )
    if force > GOOD_FORCE_PCT:
        said += (
            f" Forces are off by up to {force:.0f} %: the law that boards ship with was learned with a "
            "finger of 12 mm, others press differently; `skinbus calibrate` learns that of your cover."
        )
    return said
