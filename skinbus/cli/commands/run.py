"""`skinbus run`: the master of an arm."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, nullcontext
from functools import partial
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from rich.live import Live

from skinbus.cli import output
from skinbus.cli.attempts import Attempts
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted, nodes
from skinbus.cli.health_keeper import HealthKeeper
from skinbus.cli.host import REFRESH_S, Host, compiling
from skinbus.cli.live import Screen
from skinbus.cli.notify import Notifier
from skinbus.cli.options import Range, buses_options, file_option, json_option, level_option, seconds_option
from skinbus.cli.output import JsonFile, echo
from skinbus.cli.state_keeper import StateKeeper
from skinbus.config.system import load_arm
from skinbus.estimate import monotonic_clock
from skinbus.master import CycleReport, Master
from skinbus.master.health import Health
from skinbus.master.memory import Memory
from skinbus.master.patches.table import PatchState, PatchTable
from skinbus.model import Arm
from skinbus.skin.addresses import find_places, shown
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
    reports: deque[CycleReport] = deque(maxlen=1)
    computes: deque[int] = deque(maxlen=REMEMBERED)
    console = Console()
    notifier = Notifier()
    say = partial(console.print, soft_wrap=True)
    keeper: StateKeeper | None = None
    health: HealthKeeper | None = None

    def on_cycle(report: CycleReport) -> None:
        if writer:
            writer.write(maker.make(master, report))
        reports.append(report)
        computes.append(report.compute_ns)
        notifier.alive(
            f"{report.n_fresh} of {counted(loaded.n_patches, 'patch')}, "
            f"{counted(len(report.contacts), 'contact')}"
        )
        if keeper and health:
            keeper.copy()
            health.observe(report)

    def save() -> None:
        if keeper and health:
            keeper.write()
            health.write()

    rate = loaded.bus.rate_hz
    maker = CycleMaker(loaded)
    places = find_places(loaded.buses, interface, channels, bitrate)
    # The buses are opened first: one that cannot be is reported at once; frames are received meanwhile.
    attempts = Attempts(notifier, say, waits=wait)
    with ExitStack() as stack:
        ears = [stack.enter_context(closing(attempts.until_done(place.open))) for place in places]
        available = first_level(level)
        with compiling(console, BASE):
            master = Master(
                loaded,
                level=level,
                available=available,
                budget_us=budget_us,
                start=start,
                zero_at_start=zero,
                clock=monotonic_clock(),
                stopwatch=time.perf_counter_ns,
                unix_ns=time.time_ns,
                on_cycle=on_cycle,
            )
        for ear, place in zip(ears, places, strict=True):
            attempts.until_done(partial(refuse_other_master, ear, place, 2.0 / rate))
    host = Host(
        master,
        *(place.open for place in places),
        names=[bus.name for bus in loaded.buses],
        final_frames=master.stop,
        say=say,
        urgent=True,
    )
    writer = SharedWriter(share, maker.layout) if share else None
    if state_file:
        keeper = StateKeeper(state_file, Memory(master.cycle), loaded, say)
        keeper.resume()
        health = HealthKeeper(state_file, Health(master.cycle), say)
        health.resume()
    where = f"{counted(loaded.n_patches, 'patch')} on {shown(places)}"
    echo(f"{loaded.name}: {where}, SYNC at {rate:g} Hz; Ctrl-C stops")
    if available != level:
        say(f"contacts of level {available} until {level} is compiled")
    with closing(writer) if writer else nullcontext(), host, closing(Raising(master, available, level)):
        if quiet or not console.is_terminal:
            host.wait(seconds, then=save)
        else:
            screen = Screen(loaded)
            with Live(console=console, auto_refresh=False) as live:

                def show() -> None:
                    size = console.size
                    shown = screen.render(
                        reports[0] if reports else None, width=size.width, height=size.height
                    )
                    live.update(shown, refresh=True)
                    save()

                host.wait(seconds, REFRESH_S, show)
        notifier.stopping()
    notifier.close()
    if keeper and health:
        keeper.write(at_end=True)
        health.copy()
        health.write()
    ended_ns = reports[-1].t_ns if reports else 0
    is_alive = alive(master.table, ended_ns)
    n_alive = int(is_alive.sum())
    pace = master.level_control
    console.print(
        f"{counted(len(computes), 'cycle')}, {n_alive} of {counted(loaded.n_patches, 'patch')} alive; "
        f"{pace.overruns} late, {pace.cut_short} cut short"
    )
    for line in not_alive(loaded, master.table, is_alive):
        console.print(line, style="yellow", soft_wrap=True)
    if computes and not host.report.n_received:
        console.print(
            "no patch has sent anything: are they on this bus, powered, at this bit rate?", style="yellow"
        )
    if json_file:
        json_file.write(summary_of(master, computes, n_alive))
    if n_alive < loaded.n_patches:
        sys.exit(1)


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
