"""`skinbus board`: the EDS of a board of one's own, its file and its firmware checked."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from skinbus.cli import output
from skinbus.cli.commands.scan import candidates_of
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.host import Host
from skinbus.cli.options import bus_options, file_option, json_option
from skinbus.cli.output import JsonFile, echo
from skinbus.cli.profile_page import objects_of, page
from skinbus.errors import ConfigError, EdsError, Fault
from skinbus.file_bytes import read_bytes
from skinbus.master.commissioning.patch_check import MS, RULES, CheckedPatch, Grade, PatchCheck, RuleResult
from skinbus.master.commissioning.scan import Scanner, match
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import build_od, find_eds, load_eds, read_eds
from skinbus.objects.eds_file import MAX_BYTES, decode_text
from skinbus.objects.eds_lint import lint
from skinbus.objects.new_board import NewBoard, module_dcf
from skinbus.objects.pdo import carries_readings, readings_in, tpdos
from skinbus.skin.addresses import find_place

POLL_S = 0.05
STYLES = {Grade.PASS: "green", Grade.FAIL: "bold red", Grade.SKIPPED: "dim"}


class Grid(click.ParamType[tuple[int, int]]):
    """COLUMNSxROWS."""

    name = "grid"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return columns and rows."""
        match = re.fullmatch(r"(\d{1,2})x(\d{1,2})", str(value))
        if not match:
            self.fail(f"{value!r} is no grid: wanted COLUMNSxROWS, such as 6x6", param, ctx)
        return int(match[1]), int(match[2])


@click.group()
def command() -> None:
    """Make the EDS of a board of your own, and check its file and its firmware.

    \b
    Examples:
      skinbus board new --grid 6x6 --pitch-mm 8 --bits 12 --out my-board.eds
      skinbus board lint my-board.eds
      skinbus board check -c can0 --node 5 --eds my-board.eds
    """


@command.command()
@click.option("--grid", required=True, type=Grid(), help="Tactels: COLUMNSxROWS, at most 64.")
@click.option("--pitch-mm", required=True, type=float, help="From one tactel to the next, mm.")
@click.option("--bits", default=12, show_default=True, help="Of the converter, 8 to 16.")
@click.option(
    "--full-scale-kpa", default=250.0, show_default=True, type=float, help="Pressure at the largest reading."
)
@file_option("--out", required=True, callback=output.writable, help="Write the EDS to this file.")
def new(grid: tuple[int, int], pitch_mm: float, bits: int, full_scale_kpa: float, out: Path) -> None:
    """Write a complete EDS: all readings mapped, identifiers that clash with no other board.

    It describes to the master and to any CANopen tool what your firmware must implement; `skinbus board
    profile FILE.eds` prints that as a table. Names and numbers of the vendor are yours to fill in.

    \b
    Examples:
      skinbus board new --grid 6x6 --pitch-mm 8 --bits 12 --out my-board.eds
    """
    board = _described(grid, pitch_mm, bits, full_scale_kpa, out)
    out.write_text(board.text(), encoding="utf-8")
    within = f", the {bits} bits of the converter left-adjusted in them" if bits < board.reading_bits else ""
    said = f"{out}: {counted(board.n_tactels, 'tactel')}, {counted(board.n_tpdos, 'TPDO')} of "
    echo(f"{said}{board.reading_bits}-bit readings{within}")
    if out.suffix.lower() == ".dcf":
        echo(
            "it is an EDS, without values of a node; name it *.eds, and `skinbus calibrate` makes a DCF of it"
        )
    if board.reading_bits < bits:
        echo(
            f"readings have 8 of the {bits} bits of the converter: 16-bit readings of {board.n_tactels} "
            "tactels do not fit into the 8 TPDOs that have identifiers of their own on every node"
        )


@command.command()
@click.argument("module")
@click.option("--grid", required=True, type=Grid(), help="Tactels: COLUMNSxROWS, input 1 first.")
@click.option("--pitch-mm", required=True, type=float, help="From one tactel to the next, mm.")
@click.option("--full-scale-kpa", required=True, type=float, help="Pressure at the largest reading, 0x7FFF.")
@file_option("--out", required=True, callback=output.writable, help="Write the DCF to this file.")
def adopt(module: str, grid: tuple[int, int], pitch_mm: float, full_scale_kpa: float, out: Path) -> None:
    """Make a board of an analogue module: a DCF from its EDS (MODULE), with the tactels at its inputs.

    The module needs no firmware of ours. Its inputs are 0x6401 (CiA 401) or 0x7130 (CiA 404), all of them in
    TPDOs as delivered; the master has it send them on each SYNC.

    \b
    Examples:
      skinbus board adopt SysTec_IoX4_8AI.eds --grid 4x2 --pitch-mm 20 --full-scale-kpa 500 --out iox4.dcf
    """
    board = _described(grid, pitch_mm, 16, full_scale_kpa, out)
    try:
        path = find_eds(module)
        text, _ = decode_text(read_bytes(path, MAX_BYTES, EdsError))
        dcf = module_dcf(text, board, name=module)
    except EdsError as error:
        echo(str(error), err=True)
        sys.exit(2)
    out.write_text(dcf, encoding="utf-8")
    echo(f"{out}: {counted(board.n_tactels, 'tactel')} at the inputs of {module}")


def _described(
    grid: tuple[int, int], pitch_mm: float, bits: int, full_scale_kpa: float, out: Path
) -> NewBoard:
    """Return the board that options describe; what cannot be is a wrong use of the command."""
    columns, rows = grid
    try:
        return NewBoard(
            name=out.name,
            rows=rows,
            columns=columns,
            pitch_mm=pitch_mm,
            bits=bits,
            full_scale_pa=1e3 * full_scale_kpa,
        )
    except ValueError as error:
        raise click.UsageError(str(error)) from error


@command.command("lint")
@click.argument("eds")
def lint_eds(eds: str) -> None:
    """Check an EDS: its text, its PDOs, and that it describes a board whose readings are all sent.

    Status 0: no fault. 2: faults; all of them are listed.

    \b
    Examples:
      skinbus board lint my-board.eds
    """
    try:
        file = read_eds(eds)
        faults = lint(file)
        if faults:
            raise EdsError(eds, faults)
        od = build_od(file, 1)
        patch = describe_patch(od, eds)
    except EdsError as error:
        echo(str(error), err=True)
        sys.exit(2)
    carrying = [pdo for pdo in tpdos(od) if pdo.valid and carries_readings(pdo)]
    sent = {entry.sub for pdo in carrying for entry in readings_in(pdo)}
    silent = [k for k in range(1, patch.n_tactels + 1) if k not in sent]
    if silent:
        echo(f"{eds}: {counted(len(silent), 'reading')} in no enabled TPDO: {silent[:4]}", err=True)
        sys.exit(2)
    width, height = (1e3 * side for side in patch.size)
    echo(
        f"{eds}: no fault; {counted(patch.n_tactels, 'tactel')} on {width:g} x {height:g} mm, "
        f"{counted(len(carrying), 'TPDO')}"
    )


@command.command()
@bus_options
@click.option("--node", "node_id", required=True, type=click.IntRange(1, 126), help="Node-ID of the board.")
@click.option("--eds", help="EDS or DCF of the board; by default the one that ships and fits its identity.")
@click.option(
    "--response-ms",
    default=5.0,
    show_default=True,
    type=click.FloatRange(min=0.0, min_open=True),
    help="Longest time from SYNC to the last of its TPDOs.",
)
@click.option("--store", is_flag=True, help="Check storage too: the parameters stored in the board are lost.")
@json_option
def check(
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    node_id: int,
    eds: str | None,
    response_ms: float,
    store: bool,
    json_file: JsonFile | None,
) -> None:
    """Check the firmware of one board on a bus, rule by rule.

    The board is reset and started; nothing may press on it. No master may be at work on the bus. Status 1
    when a rule fails. The rules are in docs/profile.md.

    \b
    Examples:
      skinbus board check --channel can0 --node 5
      skinbus board check --channel can0 --node 5 --eds my-board.eds --store
    """
    place = find_place(interface, channel, bitrate)
    console = Console()
    scanner = Scanner([node_id])
    with Host(scanner, place.open, say=console.print) as host:
        host.wait(None, POLL_S)
    scanner.other_master.refuse(str(place))
    if node_id not in scanner.nodes:
        console.print(f"no node {node_id} on {place}")
        sys.exit(1)
    if eds is None:
        names = match(scanner.nodes[node_id], candidates_of(None)).names
        if not names:
            wanted = "the EDS of this board: none that ships with skinbus fits its identity"
            raise ConfigError("board check", [Fault("--eds", None, wanted)])
        eds = names[0]

    def show(result: RuleResult) -> None:
        grade, detail = result.finding.grade, result.finding.detail
        said = f"  {detail}" if detail else ""
        console.print(Text.assemble((f"{grade.value:7}", STYLES[grade]), f" {result.rule.name}{said}"))

    patch = CheckedPatch(node_id, load_eds(eds, node_id), round(response_ms * MS))
    check = PatchCheck(patch, RULES, destructive=store, on_result=show)
    console.print(f"node {node_id} on {place}, as {eds} describes it:")
    with Host(check, place.open, say=console.print) as host:
        host.wait(None, POLL_S)
    n_failed = sum(result.finding.grade is Grade.FAIL for result in check.results)
    console.print("all rules that were checked hold" if not n_failed else f"{n_failed} rules fail")
    if json_file:
        rows = [
            {"rule": r.rule.name, "grade": r.finding.grade.value.lower(), "detail": r.finding.detail}
            for r in check.results
        ]
        json_file.write({"node_id": node_id, "eds": eds, "rules": rows})
    sys.exit(0 if check.passed and len(check.results) == len(RULES) else 1)


@command.command()
@click.argument("eds", required=False)
@file_option("--out", callback=output.writable, help="Write to this file.")
def profile(eds: str | None, out: Path | None) -> None:
    """Print the profile of patches and master, or the objects of one EDS.

    \b
    Examples:
      skinbus board profile --out profile.md
      skinbus board profile my-board.eds
    """
    text = "\n\n".join(objects_of(eds)) + "\n" if eds else page()
    if out is None:
        echo(text, nl=False)
    else:
        out.write_text(text)
