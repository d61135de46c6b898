"""`skinbus board`: the EDS of a board of one's own, its firmware, both checked, and programs for boards."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import click
import numpy as np

from skinbus import model
from skinbus.arrays import Floats
from skinbus.cli import output
from skinbus.cli.commands.scan import NO_NODE
from skinbus.cli.console import Console
from skinbus.cli.host import run_to_end
from skinbus.cli.options import INPUT, POSITIVE, Where, arm_bus_options, bus_options, file_option
from skinbus.cli.output import echo
from skinbus.cli.press_csv import read_columns
from skinbus.cli.progress import progress
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import ConfigError, EdsError
from skinbus.file_bytes import read_bytes
from skinbus.firmware import write_project, write_relay
from skinbus.formatting import counted
from skinbus.gateway.positions import lay_flat
from skinbus.master.commissioning.flash import Flasher
from skinbus.master.commissioning.patch_check import (
    N_SYNCS,
    RULES,
    Grade,
    PatchCheck,
    RuleResult,
)
from skinbus.master.commissioning.scan import Scanner
from skinbus.master.commissioning.sessions import timeouts_of
from skinbus.model.patch import MAX_TACTELS
from skinbus.node.context import NS_PER_MS
from skinbus.node.sdo_server import SEGMENT
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import build_od, find_eds, load_eds, read_eds
from skinbus.objects.eds_file import text_of
from skinbus.objects.eds_lint import lint
from skinbus.objects.guard import liveness_pdo
from skinbus.objects.new_board import NewBoard, module_dcf
from skinbus.objects.pdo import carries_readings, readings_in, tpdos
from skinbus.objects.program_image import MAX_BYTES, read_image

STYLES = {Grade.PASS: "", Grade.FAIL: "bold red", Grade.SKIPPED: "dim"}


@click.group()
def command() -> None:
    """Make the EDS of a board of your own and its firmware, check both, and download programs.

    \b
    Examples:
      skinbus board new --grid 6x6 --pitch-mm 8 --bits 12 --out my-board.eds
      skinbus board lint my-board.eds
      skinbus board firmware my-board.eds --out my-board/
      skinbus board check -c can0 --node 5 --eds my-board.eds
      skinbus board flash my-arm.toml image.bin -c can0
    """


POSITIONS = tuple(
    tuple(name.format(unit) for name in names)
    for names in (("u_{}", "v_{}"), ("x_{}", "y_{}", "z_{}", "nx", "ny", "nz"))
    for unit in ("mm", "m")
)
"""Columns of the positions of tactels."""
LEAST_M = 1e-4
"""Tactels that are closer are at one place: a row is there twice."""


def _grid(ctx: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Return columns and rows."""
    if value is None:
        return None
    if not (found := re.fullmatch(r"(\d{1,2})x(\d{1,2})", value)):
        raise click.BadParameter(f"{value!r} is no grid: wanted COLUMNSxROWS, such as 6x6")
    return int(found[1]), int(found[2])


def _positions(path: Path) -> Floats:
    """Return the places of tactels on their board, (n, 2) m from its centre, and say where that is."""
    columns = read_columns(path, POSITIONS)
    names = next(names for names in POSITIONS if set(names) <= set(columns))
    table, unit = np.stack([columns[name] for name in names], -1), 1e-3 if "_mm" in names[0] else 1.0
    if len(names) == 2:
        uv = unit * table
        centre = 0.5 * (uv.max(0) + uv.min(0))
        echo("centre of the board in {}: u {:.2f} mm, v {:.2f} mm".format(path, *1e3 * centre))
        return np.asarray(uv - centre)
    flat = lay_flat(unit * table[:, :3], table[:, 3:])
    place, along = ("[{:.3f}, {:.3f}, {:.3f}]".format(*x) for x in (1e3 * flat.centre, flat.along))
    echo(f"place of the board on a mesh in the frame of {path}: xyz_mm = {place}, along = {along}")
    return flat.uv


@command.command()
@click.option("--grid", callback=_grid, help="Tactels: COLUMNSxROWS, at most 64.")
@file_option("--positions", help="CSV file with a line for each tactel, in place of a grid.")
@click.option(
    "--pitch-mm",
    type=float,
    help="From one tactel to the next, mm; for positions by default the least distance.",
)
@click.option("--bits", default=12, help="Of the converter, 8 to 16; 16 with --module.")
@click.option("--full-scale-kpa", default=250.0, type=float, help="Pressure at the largest reading.")
@click.option("--canfd", is_flag=True, help="For a bus with CAN FD: 31 readings of 16 bits in a frame.")
@click.option("--module", help="EDS of an analogue module: its inputs are the tactels, input 1 first.")
@file_option(
    "--out", required=True, callback=output.writable, help="Write the EDS, or with --module the DCF."
)
def new(
    grid: tuple[int, int] | None,
    positions: Path | None,
    pitch_mm: float | None,
    bits: int,
    full_scale_kpa: float,
    canfd: bool,
    module: str | None,
    out: Path,
) -> None:
    """Write the EDS of a board of your own.

    All readings are mapped; identifiers clash with no other board. The file describes to the master and to
    any CANopen tool what your firmware must implement, see docs/profile.md. Names and numbers of the vendor
    are yours to fill in.

    The tactels are a grid, or --positions names a CSV file with a line for each. Its columns are u_mm and
    v_mm on the board; or x_mm, y_mm, z_mm, nx, ny, nz, points and normals of the surface, which is unrolled.
    Names with _m instead of _mm are in metres.

    With --module the board is an analogue module, whose firmware is not ours, and the file a DCF. Its inputs
    are 0x6401 (CiA 401) or 0x7130 (CiA 404), all of them in TPDOs as delivered; the master has it send
    them on each SYNC.

    \b
    Examples:
      skinbus board new --grid 6x6 --pitch-mm 8 --bits 12 --out my-board.eds
      skinbus board new --positions tactels.csv --canfd --out my-board.eds
      skinbus board new --grid 4x2 --pitch-mm 20 --full-scale-kpa 500 --module IoX4_8AI.eds --out iox4.dcf
    """
    if (grid is None) == (positions is None) or (grid and pitch_mm is None):
        raise click.UsageError("wanted --grid with --pitch-mm, or --positions")
    try:
        uv = _positions(positions) if positions else model.grid(*(grid or (0, 0)), 1e-3 * (pitch_mm or 0.0))
        i, j = np.triu_indices(min(len(uv), MAX_TACTELS), 1)  # a board of more is refused below
        apart = np.hypot(*(uv[i] - uv[j]).T)
        if positions and (close := np.flatnonzero(apart < LEAST_M)).size:
            k = close[0]
            raise ValueError(f"rows {1 + i[k]} and {1 + j[k]} are {1e3 * apart[k]:.2g} mm apart")
        board = NewBoard(
            name=out.name,
            tactels_uv=uv,
            pitch=1e-3 * pitch_mm if pitch_mm else float(apart.min(initial=np.inf)),
            bits=16 if module else bits,
            full_scale_pa=1e3 * full_scale_kpa,
            canfd=canfd,
        )
        text = _dcf_of(module, board) if module else board.text()
    except ConfigError:
        raise
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    out.write_text(text, encoding="utf-8")
    if module:
        echo(f"{out}: {counted(board.n_tactels, 'tactel')} at the inputs of {module}")
        return
    echo(
        f"{out}: {counted(board.n_tactels, 'tactel')}, {counted(len(board.mapped), 'TPDO')} of "
        f"{board.reading_bits}-bit readings for the {bits} bits of the converter, left-adjusted"
    )
    if board.reading_bits < bits:
        echo("16-bit readings of more than 32 tactels need a board on CAN FD: --canfd")


def _dcf_of(module: str, board: NewBoard) -> str:
    text, _ = text_of(find_eds(module))
    return module_dcf(text, board, name=module)


@command.command("import")
@click.argument("positions", type=click.Path(path_type=Path))
@click.option("--mesh", help="Mesh of the link, in its frame, to lay the boards on; by default a fit.")
@click.option(
    "--first-board",
    default=1,
    type=click.IntRange(0, 15),
    help="Address of the first board in the file.",
)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for the files.")
def import_skin(positions: Path, mesh: str | None, first_board: int, out: Path) -> None:
    """Make an arm from a file of positions of an iCub.

    POSITIONS has the tactels of a link; an arm file and EDS files are written. Each triangle is a patch of
    `skinbus gateway icub-mtb4`. The link gets the plane or the cylinder that is nearest to its tactels; how
    far they are off it is printed. Never tried on a robot.

    Status 0: the arm can be used. 2: it has faults, which are listed; correct the files.

    \b
    Example:
      skinbus board import left_arm_mesh.txt --first-board 1 --out left-arm
    """
    from skinbus.gateway import icub

    skin = icub.read_positions(positions)
    try:
        files, fit = icub.import_skin(
            skin, first_board=first_board, mesh=os.path.relpath(mesh, out) if mesh else None
        )
    except ValueError as error:
        raise ConfigError.of(positions, "tactels", None, f"a skin, not {error}") from error
    out.mkdir(parents=True, exist_ok=True)
    for name in files:
        output.try_to_write(out / name)
    for name, text in files.items():
        (out / name).write_text(text, encoding="utf-8")
    arm = load_arm(out / next(iter(files)), check_load=False)
    rms, most = 1e3 * fit.rms, 1e3 * np.abs(fit.off).max()
    size = f"radius {1e3 * fit.surface.radius:.1f} mm" if fit.surface.period else "flat"
    echo(f"{out}: {counted(arm.n_patches, 'patch')}, {counted(int(skin.healthy.sum()), 'tactel')}")
    echo(f"nearest {fit.surface.kind}, {size}: tactels are {rms:.1f} mm off it (RMS), {most:.1f} mm at most")


@command.command("lint")
@click.argument("eds")
def lint_eds(eds: str) -> None:
    """Check the EDS of a board: text, PDOs, readings.

    All readings of the board must be sent.

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
        raise EdsError.of(eds, "TPDOs", seen, "all readings in enabled TPDOs")
    width, height = (1e3 * side for side in patch.size)
    echo(
        f"{eds}: no fault; {counted(patch.n_tactels, 'tactel')} on {width:g} x {height:g} mm, "
        f"{counted(len(carrying), 'TPDO')}"
    )


@command.command()
@click.argument("eds", required=False)
@click.option(
    "--relay", "arm", metavar="ARM", help="In place of a board: a relay that stops the robot of an arm."
)
@click.option(
    "--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder of the project."
)
def firmware(eds: str | None, arm: str | None, out: Path) -> None:
    """Write the firmware of a board as a C99 project.

    What your hardware has to do is seven functions, see ports/skeleton.c in it and docs/firmware.md. Files of
    the project that you have changed are replaced: keep your port under a name of its own.

    With --relay the project is a node without tactels, for each bus of the arm: it opens an output when a
    guarded patch says so, or nothing, see docs/firmware.md.

    \b
    Examples:
      skinbus board firmware my-board.eds --out my-board/
      skinbus board firmware --relay my-arm.toml --out relay/
    """
    if (eds is None) == (arm is None):
        raise click.UsageError("wanted the EDS of a board, or --relay with an arm")
    if out.is_dir() and any(out.iterdir()) and not (out / "core/skin.h").exists():
        raise click.BadParameter(
            f"{out} holds other files; give a new folder, or one of a project written before"
        )
    if eds is None:
        _write_relays(str(arm), out)
        return
    n_bytes, n_values = write_project(eds, out)
    echo(f"{out}: {n_values} values of {n_bytes} bytes; `make -C {out} socketcan` builds it for Linux")


def _write_relays(name: str, out: Path) -> None:
    """Write a stop relay for the guarded patches of each bus."""
    from skinbus.guard.watch import SILENT

    arm = load_arm(name)
    if arm.guard is None:
        raise click.BadParameter(f"{name} has no [guard]", param_hint="--relay")
    silent_us = round(1e-3 * SILENT * arm.guard.liveness_ns)
    pdos = [liveness_pdo(od) for od in ods_of(arm)]
    for bus, settings in enumerate(arm.buses):
        here = arm.patches_on(bus)
        ids = [pdo.cob_id for pdo, has in zip(pdos[here], arm.guarded[here], strict=True) if has and pdo]
        folder = out / settings.name if len(arm.buses) > 1 else out
        if ids:
            write_relay(name, ids, silent_us, folder)
            open_ms = 1e-3 * silent_us
            echo(f"{folder}: a relay for {counted(len(ids), 'patch')}, open after {open_ms:g} ms of silence")


@command.command()
@bus_options
@click.option("--node", "node_id", required=True, type=click.IntRange(1, 126), help="Node-ID of the board.")
@click.option("--eds", default="skin-patch", help="EDS or DCF of the board.")
@click.option(
    "--response-ms",
    default=5.0,
    type=POSITIVE,
    help="Longest time from SYNC to the last of its TPDOs.",
)
@click.option("--store", is_flag=True, help="Check storage too: the parameters stored in the board are lost.")
@click.option("--press", is_flag=True, help="Ask for a press, and check readings under it too.")
@click.option(
    "--syncs",
    default=N_SYNCS,
    type=click.IntRange(50, 1_000_000),
    help="Number of SYNCs, 20 ms each.",
)
def check(
    where: Where, node_id: int, eds: str, response_ms: float, store: bool, press: bool, syncs: int
) -> None:
    """Check the firmware of one board on a bus, rule by rule.

    The board is reset and started; nothing may press on it before --press asks for it. All boards of the bus
    are put to pre-operational. No master may be at work on the bus. Status 1 when a rule fails. The rules
    are in docs/profile.md. It cannot find samples that are one cycle old, and faults that are rarer than one
    in --syncs.

    \b
    Examples:
      skinbus board check -c can0 --node 5
      skinbus board check -c can0 --node 5 --eds my-board.eds --store
    """
    place, console = where.places()[0], Console()
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
            round(response_ms * NS_PER_MS),
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
    console.print(f"rules that fail: {n_failed}" if n_failed else "all rules that were checked hold")
    sys.exit(0 if core.passed and len(core.results) == len(RULES) else 1)


@command.command()
@click.argument("arm")
@click.argument("image", type=INPUT)
@click.option(
    "--node", "only", multiple=True, type=click.IntRange(1, 126), help="Node-ID of one of its boards."
)
@click.option("--parallel", is_flag=True, help="All boards at once, not one after another.")
@arm_bus_options
def flash(arm: str, image: Path, only: tuple[int, ...], parallel: bool, where: Where) -> None:
    """Give the boards of ARM the program of IMAGE, over the bus.

    The build of a board makes IMAGE, see docs/firmware.md. Nothing is erased unless all boards answer and the
    image is for them. Each board starts its new program, and keeps it once that was operational; otherwise it
    runs the old one again at its next start. The first board that fails is the last one, but with --parallel.
    Boards are left pre-operational; stop the master first.

    Status 0: all boards run the program. 1: one does not. 2: bad file or argument. 3: no bus, or a master
    is active.

    \b
    Examples:
      skinbus board flash my-arm.toml image.bin -c can0
      skinbus board flash my-arm.toml image.bin -c can0 --node 5
    """
    loaded, place = where.of(load_arm(arm))
    data = read_bytes(image, MAX_BYTES)
    if not (head := read_image(data)):
        raise ConfigError.of(image, "image", None, "what the build of a board makes (docs/firmware.md)")
    node_ids = only or tuple(loaded.node_id.tolist())
    console = Console()
    timeouts = timeouts_of(loaded)
    core = Flasher(node_ids, data, timeouts, asks_only=True)
    run_to_end(core, place)
    core.other_master.refuse(str(place))
    runs = core.runs
    faults = core.results
    with progress(console, "segments", len(node_ids) * len(data) // SEGMENT) as advance:
        for group in [node_ids] if parallel else [[node_id] for node_id in node_ids]:
            if len(faults) == len(node_ids) and not any(faults.values()):
                core = Flasher(group, data, timeouts, advance=advance)
                run_to_end(core, place, console.print)
                runs |= core.runs
                faults |= core.results
    console.print(f"{image}: version {head[-1]}, checksum 0x{head[0]:08X}")
    for node_id in node_ids:
        program = f"runs 0x{runs[node_id]:08X}" if node_id in runs else "is as it was"
        console.print(f"node {node_id} {program}  {faults.get(node_id, '')}".rstrip())
    sys.exit(0 if {*map(runs.get, node_ids)} == {head[0]} and not any(faults.values()) else 1)
