"""`skinbus board`: the EDS of a board of one's own, its file and its firmware checked."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Final

import click

from skinbus.cli import output
from skinbus.cli.commands.scan import NO_NODE
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.host import run_to_end
from skinbus.cli.options import BusWords, Range, bus_options, file_option
from skinbus.cli.output import echo
from skinbus.cli.progress import progress
from skinbus.errors import EdsError, Fault
from skinbus.file_bytes import read_bytes
from skinbus.master.commissioning.patch_check import (
    MS,
    N_SYNCS,
    RULES,
    Grade,
    PatchCheck,
    RuleResult,
)
from skinbus.master.commissioning.scan import Scanner
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import build_od, find_eds, load_eds, read_eds
from skinbus.objects.eds_file import MAX_BYTES, decode_text
from skinbus.objects.eds_lint import lint
from skinbus.objects.new_board import NewBoard, module_dcf
from skinbus.objects.pdo import carries_readings, readings_in, tpdos

STYLES: Final = {Grade.PASS: "", Grade.FAIL: "bold red", Grade.SKIPPED: "dim"}


@click.group()
def command() -> None:
    """Make the EDS of a board of your own, and check its file and its firmware.

    \b
    Examples:
      skinbus board new --grid 6x6 --pitch-mm 8 --bits 12 --out my-board.eds
      skinbus board lint my-board.eds
      skinbus board check -c can0 --node 5 --eds my-board.eds
    """


def _grid(ctx: click.Context, parameter: click.Parameter, value: str) -> tuple[int, int]:
    """Return columns and rows."""
    if not (found := re.fullmatch(r"(\d{1,2})x(\d{1,2})", value)):
        raise click.BadParameter(f"{value!r} is no grid: wanted COLUMNSxROWS, such as 6x6")
    return int(found[1]), int(found[2])


@command.command()
@click.option("--grid", required=True, callback=_grid, help="Tactels: COLUMNSxROWS, at most 64.")
@click.option("--pitch-mm", required=True, type=float, help="From one tactel to the next, mm.")
@click.option("--bits", default=12, show_default=True, help="Of the converter, 8 to 16; 16 with --module.")
@click.option(
    "--full-scale-kpa", default=250.0, show_default=True, type=float, help="Pressure at the largest reading."
)
@click.option("--module", help="EDS of an analogue module: its inputs are the tactels, input 1 first.")
@file_option(
    "--out", required=True, callback=output.writable, help="Write the EDS, or with --module the DCF."
)
def new(
    grid: tuple[int, int], pitch_mm: float, bits: int, full_scale_kpa: float, module: str | None, out: Path
) -> None:
    """Write a complete EDS: all readings mapped, identifiers that clash with no other board.

    It describes to the master and to any CANopen tool what your firmware must implement, see
    docs/profile.md. Names and numbers of the vendor are yours to fill in.

    With --module the board is an analogue module, whose firmware is not ours, and the file a DCF. Its inputs
    are 0x6401 (CiA 401) or 0x7130 (CiA 404), all of them in TPDOs as delivered; the master has it send
    them on each SYNC.

    \b
    Examples:
      skinbus board new --grid 6x6 --pitch-mm 8 --bits 12 --out my-board.eds
      skinbus board new --grid 4x2 --pitch-mm 20 --full-scale-kpa 500 --module IoX4_8AI.eds --out iox4.dcf
    """
    columns, rows = grid
    try:
        board = NewBoard(
            name=out.name,
            rows=rows,
            columns=columns,
            pitch_mm=pitch_mm,
            bits=16 if module else bits,
            full_scale_pa=1e3 * full_scale_kpa,
        )
        text = _dcf_of(module, board) if module else board.text()
    except EdsError:
        raise
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    out.write_text(text, encoding="utf-8")
    if module:
        echo(f"{out}: {counted(board.n_tactels, 'tactel')} at the inputs of {module}")
        return
    echo(
        f"{out}: {counted(board.n_tactels, 'tactel')}, {counted(board.n_tpdos, 'TPDO')} of "
        f"{board.reading_bits}-bit readings for the {bits} bits of the converter, left-adjusted"
    )
    if board.reading_bits < bits:
        echo("16-bit readings of so many tactels do not fit into the 8 TPDOs with identifiers of their own")


def _dcf_of(module: str, board: NewBoard) -> str:
    text, _ = decode_text(read_bytes(find_eds(module), MAX_BYTES, EdsError))
    return module_dcf(text, board, name=module)


@command.command("lint")
@click.argument("eds")
def lint_eds(eds: str) -> None:
    """Check an EDS: its text, its PDOs, and that it describes a board whose readings are all sent.

    Status 0: no fault. 2: faults; all of them are listed.

    \b
    Examples:
      skinbus board lint my-board.eds
    """
    file = read_eds(eds)
    if faults := lint(file):
        raise EdsError(eds, faults)
    od = build_od(file, 1)
    patch = describe_patch(od, eds)
    carrying = [pdo for pdo in tpdos(od) if pdo.valid and carries_readings(pdo)]
    sent = {entry.sub for pdo in carrying for entry in readings_in(pdo)}
    if silent := {*range(1, patch.n_tactels + 1)} - sent:
        seen = f"{counted(len(silent), 'reading')} in none: {sorted(silent)[:4]}"
        raise EdsError(eds, [Fault("TPDOs", seen, "all readings in enabled TPDOs")])
    width, height = (1e3 * side for side in patch.size)
    echo(
        f"{eds}: no fault; {counted(patch.n_tactels, 'tactel')} on {width:g} x {height:g} mm, "
        f"{counted(len(carrying), 'TPDO')}"
    )


@command.command()
@bus_options
@click.option("--node", "node_id", required=True, type=click.IntRange(1, 126), help="Node-ID of the board.")
@click.option("--eds", default="skin-patch", show_default=True, help="EDS or DCF of the board.")
@click.option(
    "--response-ms",
    default=5.0,
    show_default=True,
    type=Range(min=0.0, min_open=True),
    help="Longest time from SYNC to the last of its TPDOs.",
)
@click.option("--store", is_flag=True, help="Check storage too: the parameters stored in the board are lost.")
@click.option("--press", is_flag=True, help="Ask for a press, and check readings under it too.")
@click.option(
    "--syncs",
    default=N_SYNCS,
    show_default=True,
    type=click.IntRange(50, 1_000_000),
    help="SYNCs that are answered; 20 ms each.",
)
def check(
    bus: BusWords, node_id: int, eds: str, response_ms: float, store: bool, press: bool, syncs: int
) -> None:
    """Check the firmware of one board on a bus, rule by rule.

    The board is reset and started; nothing may press on it before --press asks for it. All boards of the bus
    are put to pre-operational. No master may be at work on the bus. Status 1 when a rule fails. The rules are
    in docs/profile.md. Not found: samples that are one cycle old, and what happens more rarely than --syncs.

    \b
    Examples:
      skinbus board check -c can0 --node 5
      skinbus board check -c can0 --node 5 --eds my-board.eds --store
    """
    place, console = bus.place(), Console()
    scanner = Scanner([node_id])
    run_to_end(scanner, place, console.print)
    scanner.other_master.refuse(str(place))
    if node_id not in scanner.nodes:
        console.print(f"no node {node_id} on {place}; {NO_NODE}")
        sys.exit(1)

    def show(result: RuleResult) -> None:
        rule, grade, detail = result
        console.print(f"{grade.value:7} {rule.name}  {detail}".rstrip(), style=STYLES[grade])

    console.print(f"node {node_id} on {place}, as {eds} describes it:")
    with progress(console, "SYNCs", syncs) as advance:
        core = PatchCheck(
            node_id,
            load_eds(eds, node_id),
            round(response_ms * MS),
            RULES,
            n_syncs=syncs,
            ask=console.print if press else None,
            destructive=store,
            on_sync=lambda: advance(1),
            on_result=show,
        )
        run_to_end(core, place, console.print)
    console.print("not found by this: samples that are one cycle old")
    if not press:
        console.print("with --press: readings in another scale or order, which are near 0 without")
    n_failed = sum(result.grade is Grade.FAIL for result in core.results)
    console.print(f"{n_failed} rules fail" if n_failed else "all rules that were checked hold")
    sys.exit(0 if core.passed and len(core.results) == len(RULES) else 1)
