"""`skinbus export`: a recording as MCAP or Parquet, and the PDOs of an arm as DBC."""

from __future__ import annotations

from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinbus.cli.options import channels_option, file_option, level_option, zero_option
from skinbus.cli.output import echo, try_to_write, whole_file
from skinbus.config.system import load_arm
from skinbus.errors import extra_wanted
from skinbus.file_bytes import write_whole

if TYPE_CHECKING:
    from skinbus.model import Arm

KINDS = (".mcap", ".parquet", ".dbc")


@click.command()
@click.argument("log", required=False)
@click.option("--arm", required=True, help="The arm that was recorded: a name or a TOML file.")
@file_option("--out", required=True, help="File to write: .mcap, .parquet or .dbc.")
@channels_option
@level_option()
@zero_option
def command(log: str | None, arm: str, out: Path, channels: tuple[str, ...], level: str, zero: bool) -> None:
    """Write LOG, a recording of `skinbus record` or candump, for other tools; or the PDOs of an arm as a DBC.

    \b
    .mcap     Foxglove, Lichtblick: pressures, contacts as arrows and as numbers
    .parquet  pandas, DuckDB: a row for each tactel of each cycle; FILE.contacts.parquet has the contacts
    .dbc      SavvyCAN, PlotJuggler, cantools: needs no LOG; one file for each bus, FILE.dbc or FILE-BUS.dbc

    Contacts are computed again from the readings, at --level, with covariances. The DBC decodes the contacts
    that the master published in the log.

    Status 0: written. 1: there were no readings of this arm. 2: a bad file or argument.

    \b
    Examples:
      skinbus export field.log --arm forearm --out field.mcap
      skinbus export field.log.gz --arm my-arm.toml --out field.parquet --level full
      skinbus export --arm forearm --out forearm.dbc
    """
    kind = out.suffix.lower()
    if kind not in KINDS:
        raise click.UsageError(f"{out}: a recording is written as .mcap or .parquet, the PDOs as .dbc")
    is_dbc = kind == ".dbc"
    if (log or channels or zero) if is_dbc else not log:
        wanted = "a DBC is made of the arm alone" if is_dbc else "give the recording"
        raise click.UsageError(f"{wanted}: LOG --arm ARM --out FILE, or --arm ARM --out FILE.dbc")
    loaded = load_arm(arm, check_load=False)
    with extra_wanted("export"):
        if log:
            _write_recording(Path(log), loaded, out, channels, level=level, zero=zero)
        else:
            _write_dbc(loaded, out)


def _write_dbc(arm: Arm, out: Path) -> None:
    """Write a DBC for each bus of an arm."""
    from skinbus.cli.export.dbc import dbc_of

    for bus, settings in enumerate(arm.buses):
        own = out.with_name(f"{out.stem}-{settings.name}.dbc") if len(arm.buses) > 1 else out
        try_to_write(own)
        write_whole(own, dbc_of(arm, bus).encode(), 0o644)
        echo(f"{own}: {settings.name or arm.name}")


def _write_recording(
    log: Path, arm: Arm, out: Path, channels: tuple[str, ...], *, level: str, zero: bool
) -> None:
    """Write readings and contacts; end with status 1, and no file, where there are no readings of the arm."""
    from skinbus import __version__
    from skinbus.cli.console import Console
    from skinbus.cli.recorded import Recorded

    kind = out.suffix.lower()
    files = [out] if kind == ".mcap" else [out, out.with_name(f"{out.stem}.contacts{out.suffix}")]
    for file in files:
        try_to_write(file)
    module = import_module(f"skinbus.cli.export{kind}")
    recorded = Recorded(log, arm, channels, Console(stderr=True), level=level, zero=zero)
    about = {"arm": arm.name, "log": log.name, "skinbus": __version__, "level": level}
    with ExitStack() as stack:
        parts = [stack.enter_context(whole_file(file)) for file in files]
        module.write(recorded, *parts, recorded.arm, about)
        if not recorded.has_readings():  # and what was there before stays
            raise click.exceptions.Exit(1)
    echo(f"{' and '.join(map(str, files))}: contacts at level {level}")
    for line in recorded.summary():
        echo(line)
