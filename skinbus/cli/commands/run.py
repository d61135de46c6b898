"""`skinbus run`: the master of an arm."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import click

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.host import Host, compiling
from skinbus.cli.notify import Notifier
from skinbus.cli.options import (
    Range,
    Where,
    bus_options,
    file_option,
    level_option,
    seconds_option,
    zero_option,
)
from skinbus.cli.output import echo
from skinbus.cli.state_keeper import Keeper, keep_health, keep_state
from skinbus.config.system import load_arm
from skinbus.formatting import counted
from skinbus.master import CycleReport, Master
from skinbus.master.health import Health
from skinbus.master.memory import Memory
from skinbus.master.patches.table import PatchState
from skinbus.model import Arm
from skinbus.robot.chain import check_robot
from skinbus.skin.addresses import shown
from skinbus.skin.compile_ahead import allow_when_compiled
from skinbus.skin.cycle import Cycle
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.opened import make_master
from skinbus.skin.shared_memory import SharedWriter
from skinbus.view.event_log import nodes_by_bus
from skinbus.view.screen import REFRESH_S, live_screen

RECENT_NS = 1_000_000_000
"""A patch that sent readings so long before the end was alive then."""


@click.command()
@click.argument("arm")
@bus_options
@level_option()
@click.option(
    "--budget-us",
    type=Range(min=0.0),
    help="Most time for the estimator in a cycle, us (default: what the cycle leaves).",
)
@zero_option
@click.option("--share", metavar="NAME", help="Write each cycle to shared memory, for `skinbus.attach`.")
@click.option("--quiet", is_flag=True, help="No live screen: events only, for a log.")
@file_option(
    "--state",
    "state_file",
    callback=output.state,
    help="Keep zeros and identities of contacts over restarts here, the health of tactels in FILE.health.",
)
@seconds_option
def command(
    arm: str,
    where: Where,
    level: str,
    budget_us: float | None,
    zero: bool,
    share: str | None,
    quiet: bool,
    state_file: Path | None,
    seconds: float | None,
) -> None:
    """Run the master of ARM (a name or a TOML file) until Ctrl-C, which puts the patches to pre-operational.

    If a cycle runs out of time, its contacts come from a cheaper level. If that repeats, the level is
    lowered until cycles are in time again. Late cycles are counted and published.

    SIGTERM ends it as Ctrl-C does. Status 0: all patches were alive at the end. 1: some were not. 2: bad
    file or argument. 3: no bus, or another master is active: try again later.

    \b
    Examples:
      skinbus run forearm --channel can0
      skinbus run forearm --channel can0 --level full --budget-us 800
      skinbus run my-arm.toml --interface udp_multicast --channel 239.74.163.2 --quiet
      skinbus run forearm --channel can0 --share arm
      skinbus run arm-two-buses -c upper=can0 -c lower=can1
    """
    loaded = check_robot(load_arm(arm))
    places = where.places(*loaded.buses)
    console = Console(outlives_reader=True)
    run = Run(loaded, console)
    run.master, compiler = make_master(
        loaded,
        places,
        level,
        compiling(console),
        budget_us=budget_us,
        zero_at_start=zero,
        on_cycle=run.take,
    )
    host = Host(
        run.master,
        places,
        say=run.say,
        urgent=True,
    )
    with ExitStack() as stack:
        if share:
            run.writer = stack.enter_context(closing(SharedWriter(share, run.maker.layout)))
        if state_file:
            run.keep(state_file)
        patches = f"{counted(loaded.n_patches, 'patch')} on {shown(places)}"
        echo(f"{loaded.name}: {patches}, SYNC at {loaded.bus.rate_hz:g} Hz; Ctrl-C stops")
        stack.enter_context(host)
        if compiler:
            run.say(f"contacts of level {run.master.level_control.level} until {level} is compiled")
            allow_when_compiled(run.master, level, compiler)
        with live_screen(console, loaded, is_wanted=not quiet) as show:
            host.wait(seconds, REFRESH_S, partial(run.follow, show))
        run.notifier.stopping()
    run.notifier.close()
    if run.master.gave_way:
        raise run.master.gave_way
    run.save(at_end=True)
    n_alive = run.print_end(any_received=bool(host.report.n_received))
    sys.exit(0 if n_alive == loaded.n_patches else 1)


class Run:
    """What follows the cycles of a master: screen, systemd, shared memory, files and the summary."""

    master: Master

    def __init__(self, arm: Arm, console: Console) -> None:
        self.say = console.print
        self.notifier = Notifier()
        self.maker = CycleMaker(arm)
        self.writer: SharedWriter | None = None
        self._arm = arm
        self._newest: Cycle | None = None
        self._n_cycles = 0
        self._keepers: tuple[Keeper, ...] = ()

    def keep(self, file: Path) -> None:
        """Take up state and health from files, and keep them there."""
        cycle = self.master.cycle
        self._keepers = (
            keep_state(file, Memory(cycle), self._arm, self.say),
            keep_health(file, Health(cycle), self.say),
        )

    def take(self, report: CycleReport) -> None:
        """Take a cycle; called in the thread of the master."""
        self._newest = self.maker.make(self.master, report)
        if self.writer:
            self.writer.write(self._newest)
        self._n_cycles += 1
        patches, contacts = counted(self._arm.n_patches, "patch"), counted(len(report.contacts), "contact")
        self.notifier.alive(f"{report.n_fresh} of {patches}, {contacts}")
        for keeper in self._keepers:
            keeper.take(report)

    def save(self, *, at_end: bool = False) -> None:
        """Write what is to be kept, if it is time."""
        for keeper in self._keepers:
            keeper.write(at_end=at_end)

    def follow(self, show: Callable[[Cycle | None], None]) -> None:
        """Show the newest cycle, and write what is to be kept."""
        show(self._newest)
        self.save()

    def print_end(self, *, any_received: bool) -> int:
        """Print what there was, and which patches were not alive at the end; return how many were."""
        table, pace = self.master.table, self.master.level_control
        now_ns = self._newest.t_ns if self._newest else 0
        # a few readings that are late do not make a patch dead
        recent = (table.state == PatchState.SILENT) & (table.last_fresh > now_ns - RECENT_NS)
        is_alive = (table.state == PatchState.OPERATIONAL) | recent
        n_alive = int(is_alive.sum())
        patches = f"{n_alive} of {counted(self._arm.n_patches, 'patch')} alive"
        cycles = counted(self._n_cycles, "cycle")
        self.say(f"{cycles}, {patches}; {pace.overruns} late, {pace.cut_short} cut short")
        for state in PatchState:
            for where in nodes_by_bus(self._arm, ~is_alive & (table.state == state)):
                self.say(f"{state.name.lower()}: {where}", style="yellow")
        if self._n_cycles and not any_received:
            text = "no patch has sent anything: are they on this bus, powered, at this bit rate?"
            self.say(text, style="yellow")
        return n_alive
