"""`skinbus doctor`: is this machine fit to run a master, and what is to be done where it is not."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import click

from skinbus.cli import diagnostics as checks
from skinbus.cli.diagnostics import Finding
from skinbus.cli.formatting import counted
from skinbus.cli.options import BusesWords, buses_options
from skinbus.cli.output import echo
from skinbus.config.arm_file import find_arm
from skinbus.config.system import load_arm
from skinbus.errors import AddressError, ConfigError
from skinbus.model import BusSettings
from skinbus.skin.addresses import find_places, interface_of
from skinbus.skin.shared_memory import MAX_NAME

UNIT_ARM = "/etc/skinbus/arm.toml"
"""What the unit runs by default."""


@click.command()
@click.argument("arm", required=False)
@buses_options
@click.option("--unit", is_flag=True, help="Print the systemd unit of the master for this installation.")
def command(arm: str | None, where: BusesWords, unit: bool) -> None:
    """Check the file of ARM, interface, bit rate, queue, permissions and wake-ups.

    `skinbus scan` and `skinbus configure --dry-run` check the boards.

    Nothing is changed. Status 1 when there is something to do, 2 when there is no such arm or interface.

    \b
    Examples:
      skinbus doctor my-arm.toml -c can0
      skinbus doctor /etc/skinbus/arm.toml --unit > /etc/systemd/system/skinbus-master.service
    """
    if unit:
        if any(where):
            raise click.UsageError("the unit is for SocketCAN and the channels of the arm file")
        echo(unit_text(arm), nl=False)
        return
    n = 0
    for finding in examine(arm, *where):
        n += bool(finding.advice)
        echo(f"{'fix' if finding.advice else 'ok ':4} {finding.check:20} {finding.found}")
        if finding.advice:
            echo(f"{'':25} -> {finding.advice}")
    echo(f"{counted(n, 'thing')} to do" if n else "all is well")
    sys.exit(1 if n else 0)


def examine(
    name: str | None, interface: str | None, channels: tuple[str, ...], bitrate: int | None
) -> Iterator[Finding]:
    """Return the findings, one check after the other."""
    arm = None
    if name:
        try:
            arm = load_arm(name)
            speeds = " and ".join(f"{bus.bitrate // 1000} kbit/s" for bus in arm.buses)
            patches = f"{counted(arm.n_patches, 'patch')} at {arm.bus.rate_hz:g} Hz"
            yield Finding("arm", f"{arm.name}: {patches}, {speeds}")
        except ConfigError as error:
            if not Path(name).exists():
                raise  # a slip of the keyboard; nothing of what follows was meant
            yield Finding("arm", str(error), "mend the file")
    buses = arm.buses if arm else (BusSettings(),)
    interface_of(buses[0], interface)  # one that there is not is a slip, too
    try:
        places = find_places(buses, interface, channels, bitrate)
    except AddressError as error:
        yield Finding("channel", str(error), "say it by -c, or in the arm file")
        places = []
    for place in places:
        found = list(checks.check_interface(place)) if place.interface == "socketcan" else []
        yield from found
        if not any(finding.check == "interface" and finding.advice for finding in found):
            yield from checks.check_open(place)
    yield from checks.check_machine()


def unit_text(arm: str | None = None) -> str:
    """Return the systemd unit of the master of an arm, with the path of this installation."""
    if arm:
        load_arm(arm)  # refused here, not at every start
    file = str(find_arm(arm).resolve()) if arm else UNIT_ARM
    program = _word(str(Path(sys.executable).parent / "skinbus"))
    share = re.sub(r"[^A-Za-z0-9_.-]", "-", Path(file).stem)[:MAX_NAME]
    run = f"{program} run {_word(file)} --quiet --state %S/skinbus/state --share {share}"
    template = resources.files("skinbus.cli").joinpath("skinbus-master.service").read_text()
    return template.replace("@COMMAND@", run).replace("@WARM@", f"{program} doctor warm")


def _word(word: str) -> str:
    """Return a word of a command as systemd reads it."""
    word = word.replace("%", "%%").replace("$", "$$")
    return word if re.fullmatch(r"[^\s\"'\\;]+", word) and word.isprintable() else json.dumps(word)
