"""`skinbus scan identify`: which board sits where, by pressing one after the other."""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from skinbus.arrays import Floats
from skinbus.cli.arm_target import arm_target
from skinbus.cli.commands.scan import NO_NODE
from skinbus.cli.console import Console
from skinbus.cli.host import QUICK_S, Host, compiling, run_to_end
from skinbus.cli.options import Where, arm_bus_options, file_option
from skinbus.config.arm_edit import write_arm
from skinbus.config.arm_file import find_arm, read_arm_file
from skinbus.config.system import load_arm
from skinbus.formatting import counted
from skinbus.master.commissioning.identification import Identification
from skinbus.master.commissioning.scan import Scanner
from skinbus.master.commissioning.unplaced_boards import (
    QuietMaster,
    Unplaced,
    changes_of,
    places_of,
    unplaced,
)
from skinbus.master.patches.provisioning import NUMBERS
from skinbus.model import Arm
from skinbus.skin.addresses import BusAddress, bus_numbers

Say = Callable[..., Any]


@click.command()
@click.argument("arm")
@arm_bus_options
@file_option("--out", help="Write this arm file in place of ARM.")
def command(arm: str, where: Where, out: Path | None) -> None:
    """Find which board sits where on ARM: the command asks for presses at one place after the other.

    Press each place at its centre. The command names a wrong press and asks again. Then it writes node-IDs
    and serial numbers into the arm file; comments stay. `skinbus calibrate locate` finds boards that are
    turned or mirrored. A ring whose boards differ becomes single patches. Each board needs a node-ID, no
    matter which: `skinbus scan assign` gives one to boards without.

    Boards are started as the patch of ARM with their node-ID, else as the first one of their kind, and lose
    another configuration that they have stored: run `skinbus configure` afterwards. No file is written after
    `quit` or Ctrl-C. Several buses are identified one by one (--bus).

    Status 0: every place has its board. 1: some have none. 2: bad file or argument. 3: no bus, or a master
    is active.

    \b
    Examples:
      skinbus scan identify my-arm.toml -c can0
      skinbus scan identify my-arm.toml -c can0 --out found.toml
    """
    path, whole = find_arm(arm), load_arm(arm, check_load=False)
    target = arm_target(arm, path, whole, out)
    part, place = where.of(whole)
    number = bus_numbers(whole, where.names)[0]
    mountings = [mounting for mounting in read_arm_file(path).mountings if mounting.bus == number]
    console = Console()
    say = console.print
    bench = boards_on(place, part, say)
    dialogue = Identification(places_of(part), bench.boards)
    talk(dialogue, bench.arm, place, console, say)
    if dialogue.is_quit or not dialogue.found:
        say("Nothing is written.")
        sys.exit(1)
    changes = changes_of(mountings, dialogue.found)
    write_arm(path, target, changes)
    say(f"{target}: {counted(len(changes), 'table')} changed" if changes else f"{target}: all is as it was")
    missing = [own for own in dialogue.places if own.key not in dialogue.found]
    for own in missing:
        say(f"no board was found at {own.label}", style="yellow")
    sys.exit(1 if missing else 0)


def boards_on(place: BusAddress, part: Arm, say: Say) -> Unplaced:
    """Return the boards on a bus; without one there is nothing to press."""
    scanner = Scanner()
    run_to_end(scanner, place, say)
    scanner.other_master.refuse(str(place))
    bench = unplaced(scanner.nodes.values(), part)
    strangers = scanner.nodes if bench is None else bench.strangers
    for n in strangers:
        is_silent = len(scanner.nodes[n].numbers) < len(NUMBERS)
        why = "answered no SDO request, or not all" if is_silent else "of no kind that the arm file has"
        say(f"node {n}: {why}; left out", style="yellow")
    if scanner.has_unconfigured:
        say("a node has no node-ID yet: `skinbus scan assign` gives it one", style="yellow")
    elif not scanner.nodes:
        say(NO_NODE, style="yellow")
    if bench is None:
        sys.exit(1)
    if (n := bench.arm.n_patches) < part.n_patches:
        say(f"{counted(n, 'board')} on the bus, {part.n_patches} in the arm file", style="yellow")
    return bench


def talk(dialogue: Identification, arm: Arm, place: BusAddress, console: Console, say: Say) -> None:
    """Run the dialogue on a bus until it is over; Ctrl-C leaves the rest for later."""
    cycles: deque[tuple[int, Floats]] = deque()
    typed: deque[str] = deque()
    threading.Thread(target=_read, args=(sys.stdin, typed), name="typed lines", daemon=True).start()
    with compiling(console):
        master = QuietMaster(arm, lambda *cycle: cycles.append(cycle))

    def go_on() -> None:
        while cycles and not dialogue.is_over:
            answers = [typed.popleft() for _ in range(len(typed))]
            for text in dialogue.step(*cycles.popleft(), answers):
                say(text)

    with Host(master, [place], say=say) as host:
        host.wait_until(lambda: dialogue.is_over, QUICK_S, go_on)
    dialogue.is_quit |= not dialogue.is_over


def _read(stdin: Any, lines: deque[str]) -> None:
    with suppress(OSError, ValueError):  # a terminal that has gone
        lines.extend(stdin)
