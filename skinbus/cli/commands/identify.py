"""`skinbus scan identify`: which board sits where, by pressing one after the other."""

from __future__ import annotations

import sys
import zlib
from collections import deque
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt

from skinbus.cli import output
from skinbus.cli.commands.assign import line, wanted_by
from skinbus.cli.commands.scan import NO_NODE
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted, nodes
from skinbus.cli.host import Host, compiling
from skinbus.cli.options import arm_bus_options, file_option
from skinbus.cli.output import echo
from skinbus.cli.typed_lines import TypedLines
from skinbus.config.arm_edit import write_arm
from skinbus.config.arm_file import find_arm, read_arm_file
from skinbus.config.placement import Mounting
from skinbus.config.state_file import StateFile
from skinbus.config.system import load_arm
from skinbus.master.commissioning.identification import Identification, Identified
from skinbus.master.commissioning.node_id_assignment import Assigned, Assigner
from skinbus.master.commissioning.scan import NUMBERS, Found, Scanner
from skinbus.master.commissioning.unplaced_boards import (
    QuietMaster,
    Unplaced,
    changes_of,
    places_of,
    unplaced,
    wanted_numbers,
    with_numbers,
)
from skinbus.model import Arm
from skinbus.skin.addresses import BusAddress, bus_numbers, find_places, one_bus
from skinbus.skin.compile_ahead import BASE

POLL_S = 0.05


@click.command()
@click.argument("arm")
@arm_bus_options
@click.option("--centres-only", is_flag=True, help="Press centres only: how boards are turned is as planned.")
@click.option(
    "--assign",
    is_flag=True,
    help="Give node-IDs by LSS: at the start to boards without one, at the end those of the arm file to all.",
)
@click.option("--restart", is_flag=True, help="Discard what an earlier run has found.")
@file_option("--out", help="Write this arm file in place of ARM.")
def command(
    arm: str,
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    bus: str | None,
    centres_only: bool,
    assign: bool,
    restart: bool,
    out: Path | None,
) -> None:
    """Find which board sits where on ARM: press the places that are asked for, one after the other.

    Each place is pressed at its centre and at two corners, which show how the board is turned and whether it
    is mirrored. A wrong press is named and asked for again. Then node-IDs, serial numbers and yaws go
    into the arm file; its comments stay. A ring whose boards differ becomes single patches.

    What was found is kept beside the arm file until it is written:
    after an interruption the same command goes on. Several buses are identified one by one (--bus).

    Status 0: every place has its board. 1: not so. 2: bad file or argument. 3: no bus, or a master is active.

    \b
    Examples:
      skinbus scan identify my-arm.toml --channel can0
      skinbus scan identify my-arm.toml --channel can0 --assign
      skinbus scan identify my-arm.toml --channel can0 --out found.toml
    """
    path = find_arm(arm)
    whole = load_arm(arm, check_load=False)
    if any(placed.on_chart is not None for placed in whole.patches):
        raise click.UsageError(f"{arm} has boards on meshes: their node-IDs are written by hand")
    part = one_bus(whole, bus)
    number = bus_numbers(whole, [bus] if bus else [])[0]
    arm_file = read_arm_file(path)
    mountings = [m for m in arm_file.mountings if m.bus == number]
    target = out or (path if str(path) == arm else None)
    if target is None:
        raise click.UsageError(f"{arm} ships with skinbus and is not written; say where to by --out")
    output.try_to_write(target)
    output.keep_files([target], arm, arm_file.files[1:])  # the first is the arm file
    progress = KeptPlaces(target, part, mountings)
    if restart:
        progress.forget()
    (place,) = find_places(part.buses, interface, (channel,) if channel else (), bitrate)
    console = Console()
    say = partial(console.print, soft_wrap=True)
    new_numbers = give_numbers(part, place, say) if assign else frozenset()
    bench = boards_on(place, part, say)
    if bench.arm.n_patches < part.n_patches:
        say(
            f"{counted(bench.arm.n_patches, 'board')} on the bus, {part.n_patches} in the arm file",
            style="yellow",
        )
    dialogue = Identification(
        places_of(part, mountings),
        bench.boards,
        turns=not centres_only,
        found=progress.load(),
    )
    talk(dialogue, bench, place, console, progress)
    for text in dialogue.summary():
        say(text)
    if dialogue.is_quit or not dialogue.found:
        say("Nothing is written; the same command goes on." if dialogue.found else "Nothing was found.")
        sys.exit(1)
    found = renumber(dialogue.found, mountings, place, say) if assign else dialogue.found
    changes = changes_of(mountings, found, new_numbers=new_numbers)
    write_arm(path, target, changes)
    progress.forget()
    say(f"{target}: {counted(len(changes), 'table')} changed" if changes else f"{target}: all is as it was")
    missing = dialogue.missing()
    for own in missing:
        say(f"no board was found at {own.label}", style="yellow")
    sys.exit(1 if missing else 0)


class KeptPlaces:
    """What was found so far, in a file beside the arm file; that of another arm is not used."""

    def __init__(self, target: Path, part: Arm, mountings: Sequence[Mounting]) -> None:
        self._file = StateFile(target.with_name(f"{target.name}.identify"))
        whole = [(m.key, m.link, m.s, m.a, m.yaw) for m in mountings]
        self._places = f"{part.bus.name}/{zlib.crc32(repr(whole).encode()):08x}"

    def load(self) -> dict[str, Identified]:
        """Return what an earlier run has found; nothing that is in the file raises."""
        state = self._file.load() or {}
        if state.get("places") != self._places:
            return {}
        try:
            return {
                key: Identified(
                    int(own["node_id"]), tuple(own["identity"]), float(own["yaw"]), bool(own["mirrored"])
                )
                for key, own in state["found"].items()
            }
        except (AttributeError, KeyError, TypeError, ValueError):  # written by another program
            return {}

    def save(self, dialogue: Identification) -> None:
        """Keep what was found."""
        self._file.save({"places": self._places, "found": dialogue.table()})

    def forget(self) -> None:
        """Delete the file."""
        self._file.path.unlink(missing_ok=True)
        self._file.before.unlink(missing_ok=True)


def give_numbers(part: Arm, place: BusAddress, say: Any) -> frozenset[int]:
    """Give node-IDs of the arm file to the nodes that have none; return those that were given."""
    known, free, hints = wanted_by(part)
    core = Assigner(known=known, free=free, hints=hints, on_result=lambda result: say(line(result)))
    with Host(core, place.open, say=say) as host:
        host.wait(None, POLL_S)
    core.scanner.other_master.refuse(str(place))
    if core.is_over_full:
        say("nodes without node-ID are left, and no free node-ID for them", style="yellow")
    elif not all(result.outcome.is_good for result in core.results):
        say("to try again: quit, and start the same command once more", style="yellow")
    return frozenset(r.node_id for r in core.results if r.outcome is Assigned.ASSIGNED)


def boards_on(place: BusAddress, part: Arm, say: Any) -> Unplaced:
    """Return the boards on a bus; without one there is nothing to press."""
    scanner = Scanner()
    with Host(scanner, place.open, say=say) as host:
        host.wait(None, POLL_S)
    scanner.other_master.refuse(str(place))
    found: list[Found] = list(scanner.nodes.values())
    bench = unplaced(found, part)
    strangers = [node.node_id for node in found] if bench is None else bench.strangers
    silent = [n for n in strangers if len(scanner.nodes[n].numbers) < len(NUMBERS)]
    others = [n for n in strangers if n not in silent]
    if silent:
        say(f"{nodes(silent)}: answered no SDO request, or not all; left out", style="yellow")
    if others:
        say(f"{nodes(others)}: of no kind that the arm file has; left out")
    if scanner.has_unconfigured:
        say("a node has no node-ID yet: --assign gives it one", style="yellow")
    if bench is None:
        if not found and not scanner.has_unconfigured:
            say(NO_NODE, style="yellow")
        sys.exit(1)
    return bench


def talk(
    dialogue: Identification, bench: Unplaced, place: BusAddress, console: Console, progress: KeptPlaces
) -> None:
    """Run the dialogue on the bus until it is over."""
    cycles: deque[tuple[int, npt.NDArray[np.float64]]] = deque()
    typed = TypedLines()
    n_found = len(dialogue.found)
    with compiling(console, BASE):
        master = QuietMaster(bench.arm, lambda *cycle: cycles.append(cycle))

    def follow() -> None:
        nonlocal n_found
        answers = typed.take()
        while cycles:
            for text in dialogue.step(*cycles.popleft(), answers):
                echo(text)
            answers = []
        if answers:
            typed.put_back(answers)
        if dialogue.is_complete and typed.has_ended:
            dialogue.is_over = True
        if len(dialogue.found) != n_found:
            n_found = len(dialogue.found)
            progress.save(dialogue)

    with Host(
        master, place.open, final_frames=master.stop, say=partial(console.print, soft_wrap=True)
    ) as host:
        host.wait_until(lambda: dialogue.is_over, POLL_S, follow)
    if not dialogue.is_over:  # Ctrl-C
        dialogue.is_quit = True


def renumber(
    found: dict[str, Identified], mountings: Sequence[Mounting], place: BusAddress, say: Any
) -> dict[str, Identified]:
    """Give the boards that were found the node-IDs of the arm file; return them with those they have then."""
    known = wanted_numbers(found, mountings)
    if not known:
        return found
    if len({address for address, _ in known}) < len(known):
        say("boards have one identity, serial number and all: their node-IDs go into the file as they are")
        return found
    core = Assigner(known=known, on_result=lambda result: say(line(result)))
    with Host(core, place.open, say=say) as host:
        host.wait(None, POLL_S)
    return with_numbers(found, core.results)
