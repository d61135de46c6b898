"""`skinbus scan`: who is on the bus, in which state, and which EDS describes it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import click

from skinbus.cli.console import Console
from skinbus.cli.host import run_to_end
from skinbus.cli.options import Where, bus_options
from skinbus.formatting import counted
from skinbus.master.commissioning.scan import Candidate, Found, Match, Scanner, match
from skinbus.master.patches.provisioning import Identity
from skinbus.objects import cia
from skinbus.objects.eds import build_od, eds_names, read_eds
from skinbus.objects.profile import number_at
from skinbus.printable import printable

NO_NODE = "no node answers: is the bus powered, terminated, and at this bit rate?"
TITLES = ("node", "state", "vendor:product:revision", "serial", "EDS", "name")
IDENTITY = (
    ("vendor", cia.IDENTITY_VENDOR, "DeviceInfo", "VendorNumber"),
    ("product", cia.IDENTITY_PRODUCT, "DeviceInfo", "ProductNumber"),
    ("revision", cia.IDENTITY_REVISION, "DeviceInfo", "RevisionNumber"),
    ("serial", cia.IDENTITY_SERIAL, "DeviceComissioning", "LSS_SerialNumber"),
)
"""Numbers of 0x1018, and the keys that many EDS files have in place of defaults there."""


@click.command()
@bus_options
@click.option(
    "--eds",
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="A folder with more EDS and DCF files, beside those that ship with skinbus.",
)
def command(where: Where, folder: Path | None) -> None:
    """List every node on a bus. Nothing is changed; it takes two seconds.

    States come from heartbeats: a node without one may be pre-operational or operational. Status 1 when
    there is no node at all.

    \b
    Examples:
      skinbus scan -c can0
      skinbus scan -c can0 --eds my-boards
    """
    candidates = list(candidates_of(folder))
    scanner, place, console = Scanner(), where.places()[0], Console()
    run_to_end(scanner, place, console.print)
    nodes = [(node, match(node, candidates)) for _, node in sorted(scanner.nodes.items())]
    console.print(f"on {place}:")
    if nodes:
        console.table(TITLES, [row_of(*found) for found in nodes])
    console.print(counted(len(nodes), "node") if nodes else NO_NODE)
    if scanner.has_unconfigured:
        console.print("there are nodes without node-ID; give them one with: skinbus scan assign")
    if scanner.other_master.is_present:
        console.print("a master is at work on this bus (it sends SYNC)")
    sys.exit(0 if nodes or scanner.has_unconfigured else 1)


def candidates_of(folder: Path | None = None) -> Iterator[Candidate]:
    """Return the identities of our EDS files and of those in a folder; to match, a file may have faults."""
    files: list[str | Path] = list(eds_names())
    if folder is not None:
        files += sorted(path for path in folder.iterdir() if path.suffix.lower() in (".eds", ".dcf"))
    for path in files:
        file = read_eds(path)
        od = build_od(file, file.integer("DeviceComissioning", "NodeID") or 1)
        numbers = {
            name: number_at(od, cia.IDENTITY, sub) or file.integer(section, key) or 0
            for name, sub, section, key in IDENTITY
        }
        yield Candidate(Path(path).name, Identity(device_type=number_at(od, cia.DEVICE_TYPE), **numbers))


def row_of(node: Found, found: Match) -> tuple[str, ...]:
    """Return the row of a node in the table."""
    state = "no heartbeat" if node.state is None else node.state.name.lower().replace("_", "-")
    state += "" if node.answers else ", no SDO"
    state += f", error 0x{node.error_register:02X}" if node.error_register else ""
    numbers = [node.numbers.get(name) for name, *_ in IDENTITY]
    shown = ["-" if number is None else f"{number:X}" for number in numbers[:3]]
    names = " or ".join(found.names) or "none"
    names += "" if found.exact or not found.names else " (other revision)"
    serial = "-" if numbers[3] is None else str(numbers[3])
    return str(node.node_id), state, ":".join(shown), serial, names, printable(node.name)
