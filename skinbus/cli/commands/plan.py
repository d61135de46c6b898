"""`skinbus plan`: does the bus of an arm carry its readings in time, and what is left to compute."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, get_args

import click

from skinbus.cli.console import Console
from skinbus.cli.host import compiling
from skinbus.cli.options import LEVELS, Range, level_option
from skinbus.config.arm_tables import Bitrate
from skinbus.formatting import counted

if TYPE_CHECKING:
    from skinbus.model import Arm
    from skinbus.model.guard import GuardSettings
    from skinbus.planning.plan import Plan


@click.command()
@click.argument("arm")
@click.option(
    "--bitrate", type=click.Choice([*map(str, get_args(Bitrate))]), help="Bit/s instead of the arm file's."
)
@click.option("--rate", type=Range(0.5, 2000.0), help="SYNC rate in Hz instead of the arm file's.")
@level_option("Level whose worst case must fit; `run` falls back to kmeans when time runs out.")
@click.option(
    "--compute-us",
    type=Range(min=0.0),
    help="Compute time of a cycle on the target; without it, every level is timed on this machine.",
)
@click.option(
    "--response-us",
    default=100.0,
    type=Range(min=0.0),
    help="Longest time of a patch from the end of the SYNC to its readings in the send queue.",
)
def command(
    arm: str,
    bitrate: str | None,
    rate: float | None,
    level: str,
    compute_us: float | None,
    response_us: float,
) -> None:
    """Compute whether the buses of ARM (a name or a TOML file) hold its rate: status 0 if so, 1 if not.

    Times are worst cases by exact schedulability analysis of CAN, not averages.

    \b
    Examples:
      skinbus plan forearm
      skinbus plan forearm --rate 100 --level full
      skinbus plan my-arm.toml --bitrate 500000 --compute-us 800
    """
    from skinbus.config.system import load_arm
    from skinbus.planning.plan import plans
    from skinbus.robot.chain import check_robot

    loaded = check_robot(load_arm(arm, check_load=False))
    console = Console()
    results = plans(
        loaded,
        _time_levels(loaded, console) if compute_us is None else {level: round(1e3 * compute_us)},
        level=level,
        bitrate=int(bitrate or 0),
        rate_hz=rate,
        response_ns=round(1000 * response_us),
    )
    for result in results:
        _show(result, loaded.guard, console)
    free = [loaded.node_label(p) for p, is_guarded in enumerate(loaded.guarded) if not is_guarded]
    if loaded.guard and free:
        console.print(f"! not guarded: patches {', '.join(free)}", style="yellow")
    sys.exit(0 if all(result.holds for result in results) else 1)


def _time_levels(arm: Arm, console: Console) -> dict[str, int]:
    """Return the 99th percentile of a cycle's compute time by level, ns, measured here."""
    import numpy as np

    from skinbus.planning.traffic import CONTACTS
    from skinbus.study.instant import time_cycles

    n = min(CONTACTS, arm.n_patches)
    console.print("timing the levels on this machine ...")
    with compiling(console):
        return {
            # Time of this thread: what other programs take is not a property of the plan.
            level: round(
                float(np.percentile(time_cycles(arm, level, stopwatch=time.thread_time_ns, n_contacts=n), 99))
            )
            for level in LEVELS
        }


def _show(plan: Plan, guard: GuardSettings | None, console: Console) -> None:
    """Print the plan as text."""
    from skinbus.planning.guard import guard_bound
    from skinbus.planning.traffic import ASSUMED

    speed = f"{plan.bitrate / 1e6:g} Mbit/s"
    if plan.data_bitrate:
        speed += f", CAN FD at {plan.data_bitrate / 1e6:g} Mbit/s"
    console.print(
        f"{plan.arm}: {counted(len(plan.ods), 'patch')}, {speed}, {plan.rate_hz:g} Hz, level {plan.level}"
    )
    facts = {
        "bus load at worst": f"{100 * plan.load:.1f} %, of it the cycle {100 * plan.cyclic_load:.1f} %",
        "last reading in, ms after SYNC": _ms(plan.readings_ns),
        "last contact out, ms after SYNC": _ms(plan.published_ns),
        "touch to contact, ms, a period included": _ms(plan.latency_ns),
        **{
            f"level {fit.level}": f"computes {_ms(fit.compute_ns)} ms (p99): "
            f"{'fits' if fit.holds else 'does not fit'}; up to {fit.largest_hz:g} Hz"
            for fit in plan.levels
        },
        "assumed": ASSUMED,
    }
    if guard and (bound := guard_bound(plan, guard)):
        facts["guard, ms from a limit to GFC on the wire"] = _ms(bound.frame_ns)
        facts |= {f"  {part.name}": f"{_ms(part.ns)}  {part.assumed}" for part in bound.parts}
        facts["guard, ms to standstill"] = f"{_ms(bound.standstill_ns)}  with reaction_ms and stop_ms"
    for name, text in facts.items():
        console.print(f"{name:40} {text}")
    for warning in plan.warnings:
        console.print(f"! {warning}", style="yellow")
    verdict = "does not hold: make one of the changes above, or several, and plan again"
    if plan.holds:
        verdict = (
            f"holds: every message is in time at {plan.rate_hz:g} Hz, {100 * (1 - plan.load):.0f} % of the "
            f"bus is free, a touch is published within {_ms(plan.latency_ns)} ms"
        )
    console.print(f"the plan {verdict}", style="bold")


def _ms(ns: int | None) -> str:
    return "no bound" if ns is None else f"{ns / 1e6:.2f}"
