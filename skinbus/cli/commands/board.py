"""`skinbus board`: the EDS of a board of one's own, made and checked."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import click

from skinbus.cli import output
from skinbus.cli.formatting import counted
from skinbus.cli.options import file_option
from skinbus.cli.output import echo
from skinbus.errors import EdsError
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import build_od, find_eds, read_eds
from skinbus.objects.eds_file import MAX_BYTES, decode_text
from skinbus.objects.eds_lint import lint
from skinbus.objects.file_bytes import read_bytes
from skinbus.objects.module_board import module_dcf
from skinbus.objects.new_board import NewBoard
from skinbus.objects.pdo import carries_readings, readings_in, tpdos


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
    """Make the EDS of a board of your own, and check it.

    \b
    Examples:
      skinbus board new --grid 6x6 --pitch-mm 8 --bits 12 --out my-board.eds
      skinbus board check my-board.eds
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

    It describes to the master and to any CANopen tool what your firmware must implement; `skinbus profile
    FILE.eds` prints that as a table. Names and numbers of the vendor are yours to fill in.
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


@command.command()
@click.argument("eds")
def check(eds: str) -> None:
    """Check an EDS: its text, its PDOs, and that it describes a board whose readings are all sent.

    Status 0: no fault. 2: faults; all of them are listed.
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
