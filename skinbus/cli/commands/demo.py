"""`skinbus demo`: simulated patches and a master on one virtual bus, contacts live beside the truth."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Mapping
from contextlib import closing
from functools import partial
from typing import Any

import click
import numpy as np
from rich.console import Group
from rich.live import Live
from rich.table import Table

from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.core import Step
from skinbus.can.fd_bits import frame_ns
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.host import REFRESH_S, Host, compiling
from skinbus.cli.live import Screen
from skinbus.cli.options import json_option, level_option
from skinbus.cli.output import JsonFile
from skinbus.config.system import ods_of
from skinbus.master import CycleReport, Master
from skinbus.sim import Scene, World, load_scene
from skinbus.skin.compile_ahead import SIMULATED, Raising, first_level
from skinbus.study.score import Points, Score

STEADY_CHANGE = 0.1
"""Force may change by this share in that time: a stroke is steady, putting a finger down is not."""

UNTOUCHED_S = 0.5
"""A scene that nothing touches at this time has its patches zeroed, as people do with an arm they set up: all
patches have booted by then."""

SETTLE_S = 0.06
"""A truth is steady when no touch begins, ends or changes force so long before and after: three cycles."""

GOOD_FORCE_PCT = 20.0
"""What a law that was learned with another finger is off by, at least."""


@click.command()
@click.argument("scene", default="forearm")
@level_option()
@json_option
def command(scene: str, level: str, json_file: JsonFile | None) -> None:
    """Run the whole pipeline in one process: simulated patches, a CAN bus, the master, contacts and truth.

    \b
    Examples:
      skinbus demo
      skinbus demo arm --json summary.json
    """
    played = load_scene(scene)
    console = Console()
    demo = Demo(played)
    available = first_level(level)
    with compiling(console, SIMULATED):
        master = Master(
            played.arm,
            level=level,
            available=available,
            zero_at_start=not len(played.touches_at(UNTOUCHED_S).touch),
            stopwatch=time.perf_counter_ns,
            on_cycle=demo.on_cycle,
        )
    world = World(played, ods_of(played.arm))

    buses = played.arm.buses

    def open_bus(number: int) -> PythonCanBus:
        fd = buses[number].data_bitrate is not None
        return PythonCanBus("virtual", f"skinbus-demo-{os.getpid()}-{number}", fd=fd)

    opening = [partial(open_bus, k) for k in range(len(buses))]
    rate = played.arm.bus.rate_hz
    console.print(
        f"{played.name}: {counted(played.arm.n_patches, 'patch')} at {rate:g} Hz, {played.duration_s:g} s"
    )
    if available != level:
        console.print(f"contacts of level {available} until {level} is compiled")
    screen = Screen(played.arm)
    with (
        Host(world, *opening, say=console.print, on_step=demo.on_step),
        Host(master, *opening, final_frames=master.stop, say=console.print, on_step=demo.on_step) as host,
        closing(Raising(master, available, level)),
    ):
        # Booting takes a moment before scene time begins; the margin is never used up.
        limit = time.monotonic() + played.duration_s + 10.0

        def is_over() -> bool:
            return bool(demo.scene_time(world) >= played.duration_s) or time.monotonic() > limit

        if console.is_terminal:
            with Live(console=console, auto_refresh=False) as live:

                def show() -> None:
                    live.update(demo.frame(screen, world, *console.size), refresh=True)

                host.wait_until(is_over, REFRESH_S, show)
                show()  # what stays on the screen is the last cycle
        else:
            host.wait_until(is_over, REFRESH_S, lambda: demo.score_new(world))
    demo.score_new(world)
    summary = demo.summary()
    console.print(_table(summary))
    if available == level:
        console.print(verdict(summary), soft_wrap=True)
    else:
        console.print(f"These are figures of level {available}, mostly: run it again for those of {level}.")
    if json_file:
        json_file.write(summary)


class Demo:
    """Collects what the master reports, scores it against the truth, and measures the bus."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._score = Score(scene.arm)
        self._new: deque[CycleReport] = deque()
        self._last: CycleReport | None = None
        self._compute_ns: list[int] = []
        self._sent: deque[tuple[int, int]] = deque()
        """When frames were sent, and how long they take on the wire, ns."""

    def on_cycle(self, report: CycleReport) -> None:
        """Take a report of the master; called from its thread."""
        self._new.append(report)

    def on_step(self, step: Step) -> None:
        """Take what patches or master send; called from the thread of each."""
        if self._compute_ns:  # the load is that of running, not of booting
            buses = self._scene.arm.buses
            times = (frame_ns(f, buses[f.bus].bitrate, buses[f.bus].data_bitrate) for f in step.frames)
            self._sent.append((time.monotonic_ns(), sum(times)))

    def scene_time(self, world: World) -> float:
        """Return the scene time of the last cycle, s."""
        return self._sampled_at(world, self._last) if self._last else 0.0

    def frame(self, screen: Screen, world: World, width: int, height: int) -> Group:
        """Score what is new and return the screen of a terminal of this size."""
        self.score_new(world)
        if self._last is None:
            return screen.render(None)
        touches = self._scene.touches_at(self.scene_time(world))
        truth = zip(
            touches.link.tolist(), touches.s.tolist(), touches.a.tolist(), touches.force.tolist(), strict=True
        )
        return screen.render(self._last, list(truth), width=width, height=height)

    def score_new(self, world: World) -> None:
        """Hold the cycles since the last call against the truth, where it is steady."""
        while self._new:
            report = self._last = self._new.popleft()
            self._compute_ns.append(report.compute_ns)
            t_s = self._sampled_at(world, report)
            touches = self._scene.touches_at(t_s)
            if report.n_fresh < self._scene.arm.n_patches or not self._is_steady(t_s):
                continue
            contacts = report.contacts
            self._score.add(
                Points(touches.touch, touches.link, touches.s, touches.a, touches.force),
                Points(report.ids, contacts.link, contacts.s, contacts.a, contacts.force),
            )

    def summary(self) -> dict[str, object]:
        """Return the figures that the demo ends with."""
        p50, p99 = np.percentile(self._compute_ns, [50, 99]) / 1e3
        seconds = (self._sent[-1][0] - self._sent[0][0]) * 1e-9
        busy_ns = sum(ns for _, ns in self._sent)
        n_buses = len(self._scene.arm.buses)
        return {
            "cycles": len(self._compute_ns),
            "patches": self._scene.arm.n_patches,
            "touches": self._score.touches,
            "missed": self._score.missed,
            "false": self._score.false,
            "position_mm": self._score.position_mm(),
            "force_pct": self._score.force_pct(),
            "bus_load_pct": round(1e-7 * busy_ns / (seconds * n_buses), 1),
            "cycle_us": {"p50": round(float(p50), 1), "p99": round(float(p99), 1)},
        }

    def _sampled_at(self, world: World, report: CycleReport) -> float:
        """Return the scene time at which the patches took the readings of a report, s.

        They received its SYNC a little after the master sent it, and well before the next.
        """
        half = round(0.5e9 / self._scene.arm.bus.rate_hz)
        return world.scene_time(report.t_ns + half)

    def _is_steady(self, t_s: float) -> bool:
        now = self._scene.touches_at(t_s)
        for t in (t_s - SETTLE_S, t_s + SETTLE_S):
            other = self._scene.touches_at(t)
            if not np.array_equal(now.touch, other.touch) or not np.allclose(
                now.force, other.force, rtol=STEADY_CHANGE
            ):
                return False
        return True


def _table(summary: dict[str, object]) -> Table:
    """Return the summary as text."""
    table = Table(box=None, show_header=False, pad_edge=False)
    for key, value in summary.items():
        text = "  ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else str(value)
        table.add_row(key.replace("_", " "), text)
    return table


def verdict(summary: Mapping[str, Any]) -> str:
    """Return the sentences that the demo ends with: whether this is good, and what to do if not."""
    missed, false, force = summary["missed"], summary["false"], summary["force_pct"]["p95"]
    if not summary["touches"]:
        return "No touch was measured: this machine is too slow or too busy for the scene."
    if missed or false:
        found = (
            f"{missed} of {counted(summary['touches'], 'touch')} missed, "
            f"{counted(false, 'contact')} false: touches closer than two pitches need --level full and a "
            "calibrated law, bare skin shows none (`skinbus scene check` names them), and a busy machine may "
            "leave a level no time."
        )
    else:
        found = "Every touch was found and no contact was false."
    if force <= GOOD_FORCE_PCT:
        return found
    return (
        f"{found} Forces are off by up to {force:.0f} %: the law that boards ship with was learned with "
        "a finger of 12 mm, others press differently; `skinbus calibrate` learns that of your cover."
    )
