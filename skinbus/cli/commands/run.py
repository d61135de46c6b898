"""`skinbus run`: the master of an arm."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt
from rich.live import Live

from skinbus.cli import output
from skinbus.cli.attempts import Attempts
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted, nodes
from skinbus.cli.host import REFRESH_S, Host, compiling
from skinbus.cli.live import Screen
from skinbus.cli.notify import Notifier
from skinbus.cli.options import Range, buses_options, file_option, json_option, level_option, seconds_option
from skinbus.cli.output import JsonFile, echo
from skinbus.cli.state_keeper import HealthKeeper, StateKeeper
from skinbus.config.system import load_arm
from skinbus.estimate import monotonic_clock
from skinbus.master import CycleReport, Master
from skinbus.master.health import Health
from skinbus.master.memory import Memory
from skinbus.master.patches.table import PatchState, PatchTable
from skinbus.model import Arm
from skinbus.skin.addresses import BusAddress, find_places, shown
from skinbus.skin.compile_ahead import BASE, Raising, first_level
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.opened import refuse_other_master
from skinbus.skin.shared_memory import SharedWriter

REMEMBERED = 100_000
"""Cycles whose compute times the summary is made of, the last of a long run."""


RECENT_NS = 1_000_000_000
"""A patch that sent readings so long before the end was alive then."""


@click.command()
@click.argument("arm")
@buses_options
@level_option()
@click.option(
    "--budget-us",
    type=Range(min=0.0),
    help="Most time for the estimator in a cycle, us (default: what the cycle leaves).",
)
@click.option(
    "--start",
    type=click.Choice(["maxima", "random"]),
    default="maxima",
    show_default=True,
    help="Where clusters start: at the maxima of pressure, or at random tactels as in the paper.",
)
@click.option(
    "--zero", is_flag=True, help="Take what each patch reads first for its zero: nothing may touch the arm."
)
@click.option(
    "--share",
    metavar="NAME",
    help="Write each cycle to shared memory, for `skinbus.attach` and C programs on this machine.",
)
@click.option("--quiet", is_flag=True, help="No live screen: events only, for a log.")
@file_option(
    "--state",
    "state_file",
    callback=output.state,
    help="Keep zeros and identities of contacts over restarts here, the health of tactels in FILE.health.",
)
@click.option(
    "--wait", is_flag=True, help="Wait for a bus that is not there, and for another master to end (service)."
)
@seconds_option
@json_option
def command(
    arm: str,
    interface: str | None,
    channels: tuple[str, ...],
    bitrate: int | None,
    level: str,
    budget_us: float | None,
    start: str,
    zero: bool,
    share: str | None,
    quiet: bool,
    state_file: Path | None,
    wait: bool,
    seconds: float | None,
    json_file: JsonFile | None,
) -> None:
    """Run the master of ARM (a name or a TOML file) until Ctrl-C, which puts the patches to pre-operational.

    When time runs out, contacts keep the answer of a cheaper level and the level is lowered; it is raised
    again when there is time. Cycles that are late are counted and published.

    SIGTERM ends it as Ctrl-C does. Status 0: all patches were alive at the end. 1: not so. 2: bad file
    or argument. 3: no bus, or another master is active: a later try may succeed.

    \b
    Examples:
      skinbus run forearm --channel can0
      skinbus run forearm --channel can0 --level full --budget-us 800
      skinbus run my-arm.toml --interface udp_multicast --channel 239.74.163.2 --quiet
      skinbus run forearm --channel can0 --share arm
      skinbus run arm-two-buses -c upper=can0 -c lower=can1
    """
    loaded = load_arm(arm)
    places = find_places(loaded.buses, interface, channels, bitrate)
    console = Console()
    cycles = Cycles(loaded, console)
    available = first_level(level)
    settings = {"budget_us": budget_us, "start": start, "zero_at_start": zero}
    master = cycles.master = open_master(
        cycles, places, wait=wait, level=level, available=available, **settings
    )
    host = Host(
        master,
        *(place.open for place in places),
        names=[bus.name for bus in loaded.buses],
        final_frames=master.stop,
        say=cycles.say,
        urgent=True,
    )
    with ExitStack() as stack:
        if share:
            cycles.writer = stack.enter_context(closing(SharedWriter(share, cycles.maker.layout)))
        if state_file:
            cycles.keep(state_file)
        where = f"{counted(loaded.n_patches, 'patch')} on {shown(places)}"
        echo(f"{loaded.name}: {where}, SYNC at {loaded.bus.rate_hz:g} Hz; Ctrl-C stops")
        if available != level:
            cycles.say(f"contacts of level {available} until {level} is compiled")
        stack.enter_context(host)
        stack.enter_context(closing(Raising(master, available, level)))
        if quiet or not console.is_terminal:
            host.wait(seconds, then=cycles.save)
        else:
            cycles.show(host, seconds)
        cycles.notifier.stopping()
    cycles.notifier.close()
    cycles.save(at_end=True)
    n_alive = cycles.print_end(any_received=bool(host.report.n_received))
    if json_file:
        json_file.write(summary_of(master, cycles.computes, n_alive))
    sys.exit(0 if n_alive == loaded.n_patches else 1)


class Cycles:
    """What follows the cycles of a master: screen, systemd, shared memory, files and the summary."""

    def __init__(self, arm: Arm, console: Console) -> None:
        self.arm = arm
        self.say = partial(console.print, soft_wrap=True)
        self.notifier = Notifier()
        self.maker = CycleMaker(arm)
        self.master: Master | None = None
        self.writer: SharedWriter | None = None
        self.computes: deque[int] = deque(maxlen=REMEMBERED)
        """Compute times, ns."""
        self.console = console
        self._newest: CycleReport | None = None
        self._keepers: tuple[StateKeeper, HealthKeeper] | None = None

    def keep(self, file: Path) -> None:
        """Take up state and health from files, and keep them there."""
        assert self.master is not None
        state = StateKeeper(file, Memory(self.master.cycle), self.arm, self.say)
        health = HealthKeeper(file, Health(self.master.cycle), self.say)
        state.resume()
        health.resume()
        self._keepers = state, health

    def take(self, report: CycleReport) -> None:
        """Take a cycle; called in the thread of the master."""
        if self.writer and self.master:
            self.writer.write(self.maker.make(self.master, report))
        self._newest = report
        self.computes.append(report.compute_ns)
        patches, contacts = counted(self.arm.n_patches, "patch"), counted(len(report.contacts), "contact")
        self.notifier.alive(f"{report.n_fresh} of {patches}, {contacts}")
        if self._keepers:
            state, health = self._keepers
            state.copy()
            health.observe(report)

    def save(self, *, at_end: bool = False) -> None:
        """Write what is to be kept, if it is time."""
        for keeper in self._keepers or ():
            keeper.write(at_end=at_end)

    def show(self, host: Host, seconds: float | None) -> None:
        """Show the screen until the end."""
        screen = Screen(self.arm)
        with Live(console=self.console, auto_refresh=False) as live:

            def draw() -> None:
                size = self.console.size
                live.update(screen.render(self._newest, width=size.width, height=size.height), refresh=True)
                self.save()

            host.wait(seconds, REFRESH_S, draw)

    def print_end(self, *, any_received: bool) -> int:
        """Print what there was, and which patches were not alive at the end; return how many were."""
        assert self.master is not None
        table, pace = self.master.table, self.master.level_control
        is_alive = alive(table, self._newest.t_ns if self._newest else 0)
        n_alive = int(is_alive.sum())
        self.say(
            f"{counted(len(self.computes), 'cycle')}, {n_alive} of {counted(self.arm.n_patches, 'patch')} "
            f"alive; {pace.overruns} late, {pace.cut_short} cut short"
        )
        for line in not_alive(self.arm, table, is_alive):
            self.say(line, style="yellow")
        if self.computes and not any_received:
            self.say(
                "no patch has sent anything: are they on this bus, powered, at this bit rate?", style="yellow"
            )
        return n_alive


def open_master(cycles: Cycles, places: Sequence[BusAddress], *, wait: bool, **settings: Any) -> Master:
    """Return a master when its buses can be opened and no other master is at work on them.

    The buses are opened first: one that cannot be is reported at once; frames are received meanwhile.
    """
    attempts = Attempts(cycles.notifier, cycles.say, waits=wait)
    with ExitStack() as stack:
        ears = [stack.enter_context(closing(attempts.until_done(place.open))) for place in places]
        with compiling(cycles.console, BASE):
            master = Master(
                cycles.arm,
                clock=monotonic_clock(),
                stopwatch=time.perf_counter_ns,
                on_cycle=cycles.take,
                **settings,
            )
        for ear, place in zip(ears, places, strict=True):
            attempts.until_done(partial(refuse_other_master, ear, place, 2.0 / cycles.arm.bus.rate_hz))
    return master


def alive(table: PatchTable, now_ns: int) -> npt.NDArray[np.bool_]:
    """Return which patches are alive, (n_patches,): a few readings that are late do not make one dead."""
    recent = (table.state == PatchState.SILENT) & (table.last_fresh > now_ns - RECENT_NS)
    return np.asarray((table.state == PatchState.OPERATIONAL) | recent)


def not_alive(arm: Arm, table: PatchTable, is_alive: npt.NDArray[np.bool_]) -> Iterator[str]:
    """Return for each state the patches in it that are not alive."""
    for state in PatchState:
        for bus, settings in enumerate(arm.buses):
            patches = arm.patches_on(bus)
            dead = (table.state[patches] == state) & ~is_alive[patches]
            node_ids = arm.node_id[patches][dead].tolist()
            if node_ids:
                where = f"{settings.name} " if len(arm.buses) > 1 else ""
                yield f"{state.name.lower()}: {where}{nodes(node_ids)}"


def summary_of(master: Master, computes: Sequence[int], n_alive: int) -> dict[str, object]:
    """Return the summary of a run for a program."""
    p50, p99 = np.percentile(computes, [50, 99]) / 1e3 if computes else (0.0, 0.0)
    counters = master.gather.counters
    return {
        "cycles": len(computes),
        "patches": master.arm.n_patches,
        "alive": n_alive,
        "frames": {"accepted": counters.accepted, "lost": counters.lost, "bad_length": counters.bad_length},
        "overruns": master.level_control.overruns,
        "cut_short": master.level_control.cut_short,
        "level": master.level_control.level,
        "cycle_us": {"p50": round(float(p50), 1), "p99": round(float(p99), 1)},
    }
