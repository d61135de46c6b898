"""`skinbus demo`: simulated patches and a master on a virtual clock, contacts live beside the truth."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import nullcontext
from typing import Any

import click
import numpy as np
from rich.live import Live
from rich.table import Table

from skinbus.can.virtual_buses import VirtualBuses
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.host import REFRESH_S, compiling
from skinbus.cli.live import Screen
from skinbus.cli.options import json_option, level_option
from skinbus.cli.output import JsonFile
from skinbus.cli.stop_signals import Ending
from skinbus.config.system import ods_of
from skinbus.master import CycleReport, Master
from skinbus.sim import Scene, World, load_scene
from skinbus.study.score import Points, Score

STEADY_CHANGE = 0.1
"""Force may change by this share in that time: a stroke is steady, putting a finger down is not."""
UNTOUCHED_S = 0.5
"""A scene that nothing touches at this time has its patches zeroed: all patches have booted by then."""
SETTLE_S = 0.06
"""A truth is steady when no touch begins, ends or changes force so long before and after: three cycles."""
GOOD_FORCE_PCT = 20.0
"""A law that was learned with another finger has at least this error."""
BOOT_S = 10.0
"""Bus time that patches may take to boot before the scene is given up."""
STEP_NS = round(1e9 * REFRESH_S)
"""The wires go on by so much at a time: the period of the screen."""


@click.command()
@click.argument("scene", default="forearm")
@level_option()
@json_option
def command(scene: str, level: str, json_file: JsonFile | None) -> None:
    """Show the whole pipeline in one process: simulated patches, CAN buses, the master, contacts and truth.

    Bus and patches run on a virtual clock, so every machine gets the same contacts. In a terminal the
    scene is played in real time.

    \b
    Examples:
      skinbus demo
      skinbus demo arm --json summary.json
    """
    played = load_scene(scene)
    console = Console()
    with compiling(console):
        demo = Demo(played, level)
    rate = played.arm.bus.rate_hz
    console.print(
        f"{played.name}: {counted(played.arm.n_patches, 'patch')} at {rate:g} Hz, {played.duration_s:g} s"
    )
    screen, begin = Screen(played.arm), time.monotonic()
    live = Live(console=console, auto_refresh=False) if console.is_terminal else nullcontext()
    with Ending() as ending, live as shown:
        while demo.go_on() and not ending.asked:
            if shown:
                shown.update(demo.frame(screen, *console.size), refresh=True)
                time.sleep(max(0.0, begin + 1e-9 * demo.now_ns - time.monotonic()))
    summary = demo.summary()
    console.print(_table(summary))
    console.print(verdict(summary), soft_wrap=True)
    if json_file:
        json_file.write(summary)


class Demo:
    """Patches and a master on wires; scores what the master reports against the truth."""

    def __init__(self, scene: Scene, level: str) -> None:
        self._scene, arm = scene, scene.arm
        self._score = Score(arm)
        self._last: CycleReport | None = None
        self._compute_ns: list[int] = []
        self.now_ns = 0
        """Bus time."""
        self._world = World(scene, ods_of(arm))
        self._wires = VirtualBuses(
            [bus.bitrate for bus in arm.buses], data_bitrates=[bus.data_bitrate for bus in arm.buses]
        )
        self._wires.attach(self._world)
        self._wires.attach(
            Master(
                arm,
                level=level,
                zero_at_start=not len(scene.touches_at(UNTOUCHED_S).touch),
                stopwatch=time.perf_counter_ns,
                on_cycle=self._on_cycle,
            )
        )

    def go_on(self) -> bool:
        """Let the wires go on by a step; return False when the scene is over."""
        if self._scene_time() >= self._scene.duration_s:
            return False
        self.now_ns += STEP_NS
        self._wires.run(self.now_ns)
        return 1e-9 * self.now_ns < self._scene.duration_s + BOOT_S

    def frame(self, screen: Screen, width: int, height: int) -> Any:
        """Return the screen of a terminal of this size."""
        if self._last is None:
            return screen.render(None)
        touches = self._scene.touches_at(self._scene_time())
        columns = (touches.link, touches.s, touches.a, touches.force)
        truth = zip(*(column.tolist() for column in columns), strict=True)
        return screen.render(self._last, list(truth), width=width, height=height)

    def summary(self) -> dict[str, Any]:
        """Return the figures that the demo ends with."""
        p50, p99 = np.percentile(self._compute_ns or [0], [50, 99]) / 1e3
        return {
            "cycles": len(self._compute_ns),
            "patches": self._scene.arm.n_patches,
            "touches": self._score.touches,
            "missed": self._score.missed,
            "false": self._score.false,
            "position_mm": self._score.position_mm(),
            "force_pct": self._score.force_pct(),
            "bus_load_pct": round(100.0 * max(wire.load() for wire in self._wires.wires), 1),
            "cycle_us": {"p50": round(float(p50), 1), "p99": round(float(p99), 1)},
        }

    def _on_cycle(self, report: CycleReport) -> None:
        """Hold a cycle against the truth, where it is steady."""
        self._last = report
        self._compute_ns.append(report.compute_ns)
        t_s = self._scene_time()
        if report.n_fresh < self._scene.arm.n_patches or not self._is_steady(t_s):
            return
        touches, contacts = self._scene.touches_at(t_s), report.contacts
        self._score.add(
            Points(touches.touch, touches.link, touches.s, touches.a, touches.force),
            Points(report.ids, contacts.link, contacts.s, contacts.a, contacts.force),
        )

    def _scene_time(self) -> float:
        """Return the scene time at which the patches took the readings of the last report, s.

        They received its SYNC a little after the master sent it, and well before the next.
        """
        half = round(0.5e9 / self._scene.arm.bus.rate_hz)
        return self._world.scene_time(self._last.t_ns + half) if self._last else 0.0

    def _is_steady(self, t_s: float) -> bool:
        now = self._scene.touches_at(t_s)
        for t in (t_s - SETTLE_S, t_s + SETTLE_S):
            other = self._scene.touches_at(t)
            if not np.array_equal(now.touch, other.touch) or not np.allclose(
                now.force, other.force, rtol=STEADY_CHANGE
            ):
                return False
        return True


def _table(summary: Mapping[str, Any]) -> Table:
    """Return the summary as text."""
    table = Table(box=None, show_header=False, pad_edge=False)
    for key, value in summary.items():
        text = "  ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else str(value)
        name = "compute us, this machine" if key == "cycle_us" else key.replace("_", " ")
        table.add_row(name, text)
    return table


def verdict(summary: Mapping[str, Any]) -> str:
    """Return the sentences that the demo ends with: whether this is good, and what to do if not."""
    missed, false, force = summary["missed"], summary["false"], summary["force_pct"]["p95"]
    if not summary["touches"]:
        return "No touch was measured: the scene has none that lasts."
    if missed or false:
        found = (
            f"{missed} of {counted(summary['touches'], 'touch')} missed, "
            f"{counted(false, 'contact')} false: touches closer than two pitches need --level full and a "
            "calibrated law, and bare skin shows none (`skinbus view` shows where they are)."
        )
    else:
        found = "Every touch was found and no contact was false."
    if force <= GOOD_FORCE_PCT:
        return found
    return (
        f"{found} Forces are off by up to {force:.0f} %: the law that boards ship with was learned with "
        "a finger of 12 mm, others press differently; `skinbus calibrate` learns that of your cover."
    )
