"""`skinbus export`: a recording as MCAP or Parquet, and the PDOs of an arm as DBC."""

from __future__ import annotations

from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from skinbus.cli.options import file_option, level_option, log_channels_option
from skinbus.cli.output import echo, refuse_unreadable, try_to_write, whole_file
from skinbus.config.system import load_arm
from skinbus.errors import SkinbusError
from skinbus.objects.profile import MASTER_NODE_ID

if TYPE_CHECKING:
    from skinbus.model import Arm

DBC: Final = "dbc"
HEADS: Final = {".mcap": b"\x89MCAP", ".parquet": b"PAR1", ".dbc": b"VERSION"}
"""What files of ours begin with, by their ending: no other is written over."""


@click.command()
@click.argument("log", metavar="LOG|dbc")
@click.argument("dbc_arm", metavar="[ARM]", required=False)
@click.option("--arm", help="The arm that was recorded: a name or a TOML file.")
@file_option("--out", help="File to write: .mcap, .parquet or .dbc.")
@log_channels_option
@level_option()
@click.option("--zero", is_flag=True, help="Take the first readings of each patch as its zero.")
@click.option(
    "--node-id",
    default=MASTER_NODE_ID,
    show_default=True,
    type=click.IntRange(1, 127),
    help="Node-ID of the master in a DBC.",
)
def command(
    log: str,
    dbc_arm: str | None,
    arm: str | None,
    out: Path | None,
    channels: tuple[str, ...],
    level: str,
    zero: bool,
    node_id: int,
) -> None:
    """Write LOG, a recording of `skinbus record` or candump, for other tools; or the PDOs of ARM as a DBC.

    \b
    .mcap     Foxglove, Lichtblick: pressures, contacts as arrows and as numbers
    .parquet  pandas, DuckDB: a row for each tactel of each cycle; FILE.contacts.parquet has the contacts
    dbc ARM   SavvyCAN, PlotJuggler, cantools: one file for each bus, ARM.dbc or ARM-BUS.dbc

    Contacts are made of the readings now, at --level, with covariances. Those that the master in the log
    published are read from it by means of the DBC.

    Status 0: written. 1: there were no readings of this arm. 2: a bad file or argument.

    \b
    Examples:
      skinbus export field.log --arm forearm --out field.mcap
      skinbus export field.log.gz --arm my-arm.toml --out field.parquet --level full
      skinbus export dbc forearm
    """
    name = dbc_arm if log == DBC else arm
    if log == DBC and (name is None or arm or channels or zero):
        raise click.UsageError("wanted: skinbus export dbc ARM [--out FILE.dbc] [--node-id N]")
    if log != DBC and dbc_arm is not None:
        raise click.UsageError(f"unexpected {dbc_arm!r}: wanted LOG --arm ARM --out FILE, or dbc ARM")
    if log != DBC and (name is None or out is None):
        raise click.UsageError("wanted: --arm ARM and --out FILE; the ending of FILE is the format")
    assert name is not None
    out = out or Path(f"{Path(name).stem}.dbc")
    if out.suffix.lower() not in ([".dbc"] if log == DBC else [".mcap", ".parquet"]):
        raise click.UsageError(f"{out}: a recording is written as .mcap or .parquet, a DBC as .dbc")
    if log != DBC:
        refuse_unreadable(log)
    loaded = load_arm(name, check_load=False)
    if node_id in loaded.node_id:
        raise click.UsageError(f"--node-id {node_id} is that of a patch of {loaded.name}")
    try:
        if log == DBC:
            _write_dbc(loaded, out, node_id)
        else:
            _write_recording(Path(log), loaded, out, channels, level=level, zero=zero)
    except ImportError as error:
        raise SkinbusError(f"{out}: needs {error.name}; pip install 'skinbus[export]'") from error


def _write_dbc(arm: Arm, out: Path, node_id: int) -> None:
    """Write a DBC for each bus of an arm."""
    from skinbus.cli.export.dbc import dbc_of

    for bus, settings in enumerate(arm.buses):
        own = out.with_name(f"{out.stem}-{settings.name}.dbc") if len(arm.buses) > 1 else out
        _check(own)
        with whole_file(own) as part:
            part.write_text(dbc_of(arm, bus, node_id), encoding="ascii")
        echo(f"{own}: {settings.name or arm.name}, node-ID {node_id} is the master")


def _write_recording(
    log: Path, arm: Arm, out: Path, channels: tuple[str, ...], *, level: str, zero: bool
) -> None:
    """Write readings and contacts; end with status 1, and no file, where there are no readings of the arm."""
    from skinbus import __version__
    from skinbus.cli.console import Console
    from skinbus.cli.formatting import counted
    from skinbus.cli.host import compiling
    from skinbus.cli.recorded import Recorded

    is_mcap = out.suffix.lower() == ".mcap"
    files = [out] if is_mcap else [out, out.with_name(f"{out.stem}.contacts{out.suffix}")]
    for file in files:
        _check(file)
    module = import_module(f"skinbus.cli.export.{out.suffix.lower().removeprefix('.')}")
    console = Console(stderr=True)
    with compiling(console):
        recorded = Recorded(str(log), arm, channels, level=level, zero=zero)
    about = {"arm": arm.name, "log": log.name, "skinbus": __version__, "level": level}
    with ExitStack() as stack:
        parts = [stack.enter_context(whole_file(file)) for file in files]
        writer = module.Writer(*parts, recorded.arm, about)
        for cycle in recorded.cycles(console):
            writer.add(cycle)
        writer.close()
        if not recorded.has_readings():  # and what was there before stays
            raise click.exceptions.Exit(1)
    readings = f"{counted(recorded.n_readings, 'reading')} in {counted(recorded.n_cycles, 'cycle')}"
    contacts = f"{counted(recorded.n_contacts, 'contact')} at level {level}"
    echo(f"{' and '.join(map(str, files))}: {readings}, {contacts}")
    for line in recorded.summary():
        echo(line)


def _check(file: Path) -> None:
    head = HEADS[file.suffix.lower()]
    try_to_write(file, f"{file.suffix[1:]} file of skinbus", head)
