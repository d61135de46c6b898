"""`skinbus export`: a recording as MCAP or Parquet, and the PDOs of an arm as DBC."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import click

from skinbus.cli.export.new_file import HEADS, new_file
from skinbus.cli.options import LEVELS, file_option, log_channels_option
from skinbus.cli.output import echo, refuse_unreadable
from skinbus.config.system import load_arm
from skinbus.errors import SkinbusError
from skinbus.objects.profile import MASTER_NODE_ID

DBC: Final = "dbc"


@click.command()
@click.argument("log", metavar="LOG|dbc")
@click.argument("dbc_arm", metavar="[ARM]", required=False)
@click.option("--arm", help="The arm whose patches were recorded: a name or a TOML file.")
@file_option("--out", help="File to write: .mcap, .parquet or .dbc.")
@log_channels_option
@click.option(
    "--recompute",
    "level",
    type=click.Choice(LEVELS),
    help="Also put the log through the master at this level: contacts, and pressures less the zeros.",
)
@click.option("--zero", is_flag=True, help="With --recompute: take what each patch reads first for its zero.")
@click.option(
    "--node-id",
    default=MASTER_NODE_ID,
    show_default=True,
    type=click.IntRange(1, 127),
    help="Node-ID of the master.",
)
def command(
    log: str,
    dbc_arm: str | None,
    arm: str | None,
    out: Path | None,
    channels: tuple[str, ...],
    level: str | None,
    zero: bool,
    node_id: int,
) -> None:
    """Write LOG, a recording of `skinbus record` or candump, for other tools; or the PDOs of ARM as a DBC.

    \b
    .mcap     Foxglove, Lichtblick: links and boards, pressures, contacts as arrows and as numbers
    .parquet  pandas, DuckDB: a row for each tactel of each frame; FILE.contacts.parquet has the contacts
    dbc ARM   SavvyCAN, PlotJuggler, cantools: one file for each bus, ARM.dbc or ARM-BUS.dbc

    Contacts are those that the master in the log published, "published", rounded to 0.1 mm and 0.01 N. With
    --recompute there are also those that a master makes of the readings now, "recomputed", with covariances.
    Without it pressures are by offset and gain of each tactel, before its zero.

    Status 0: written. 1: there were no readings of this arm. 2: a bad file or argument.

    \b
    Examples:
      skinbus export field.log --arm forearm --out field.mcap
      skinbus export field.log.gz --arm my-arm.toml --out field.parquet --recompute fit
      skinbus export dbc forearm
    """
    if log == DBC:
        if dbc_arm is None or arm or channels or level or zero:
            raise click.UsageError("wanted: skinbus export dbc ARM [--out FILE.dbc] [--node-id N]")
        _export_dbc(dbc_arm, out, node_id)
        return
    if dbc_arm is not None:
        raise click.UsageError(f"unexpected {dbc_arm!r}: wanted LOG --arm ARM --out FILE, or dbc ARM")
    if out is None:
        raise click.UsageError("wanted: --out FILE; its ending is the format")
    refuse_unreadable(log)
    kind = out.suffix.lower()
    if kind not in HEADS or kind == ".dbc":
        raise click.UsageError(f"{out}: an export of a recording ends with .mcap or .parquet")
    if zero and not level:
        raise click.UsageError("--zero is for --recompute")
    if arm is None:
        raise click.UsageError(f"{kind} needs --arm: readings are decoded by the arm file")
    loaded = load_arm(arm, check_load=False)
    if node_id in loaded.node_id:
        raise click.UsageError(f"--node-id {node_id} is that of a patch of {loaded.name}")
    from skinbus.cli.export.tables import export_tables

    export_tables(Path(log), loaded, out, channels, node_id=node_id, level=level, zero=zero)


def _export_dbc(name: str, out: Path | None, node_id: int) -> None:
    """Write a DBC for each bus of an arm."""
    if out is not None and out.suffix.lower() != ".dbc":
        raise click.UsageError(f"{out}: a DBC ends with .dbc")
    try:
        from skinbus.cli.export.dbc import dbc_of
    except ImportError as error:
        raise SkinbusError(f"DBC needs {error.name}; pip install 'skinbus[export]'") from error

    arm = load_arm(name, check_load=False)
    if node_id in arm.node_id:
        raise click.UsageError(f"--node-id {node_id} is that of a patch of {arm.name}")
    path = out or Path(f"{Path(name).stem}.dbc")
    for bus, settings in enumerate(arm.buses):
        own = path.with_name(f"{path.stem}-{settings.name}.dbc") if len(arm.buses) > 1 else path
        with new_file(own) as part:
            part.write_text(dbc_of(arm, bus, node_id), encoding="ascii")
        echo(f"{own}: {settings.name or arm.name}, node-ID {node_id} is the master")
