"""`skinbus scan`: who is on the bus, in which state, and which EDS describes it."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import click
from rich.table import Table

from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.host import Host
from skinbus.cli.options import bus_options, json_option
from skinbus.cli.output import JsonFile
from skinbus.master.commissioning.scan import Candidate, Found, Match, Scanner, match
from skinbus.master.patches.provisioning import Identity
from skinbus.objects import cia
from skinbus.objects.eds import build_od, eds_names, read_eds
from skinbus.objects.profile import number_at
from skinbus.printable import printable
from skinbus.skin.addresses import find_place

POLL_S = 0.05
NO_NODE = "no node answers: is the bus powered, terminated, and at this bit rate?"


@click.command()
@bus_options
@click.option(
    "--eds",
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="A folder with more EDS and DCF files, beside those that ship with skinbus.",
)
@json_option
def command(
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    folder: Path | None,
    json_file: JsonFile | None,
) -> None:
    """List every node on a bus. Nothing is changed; it takes two seconds.

    States come from heartbeats: a node without one may be pre-operational or operational. Status 1 when
    there is no node at all.

    \b
    Examples:
      skinbus scan --channel can0
      skinbus scan --channel can0 --eds my-boards --json nodes.json
    """
    candidates = list(candidates_of(folder))
    scanner = Scanner()
    place = find_place(interface, channel, bitrate)
    console = Console()
    with Host(scanner, place.open, say=console.print) as host:
        host.wait(None, POLL_S)
    matches = {node_id: match(node, candidates) for node_id, node in scanner.nodes.items()}
    nodes = [scanner.nodes[node_id] for node_id in sorted(scanner.nodes)]
    console.print(f"on {place}:")
    if nodes:
        console.print(node_table(nodes, matches))
    for line in remarks(scanner):
        console.print(line)
    if json_file:
        summary = {
            "nodes": [as_row(node, matches[node.node_id]) for node in nodes],
            "unconfigured": scanner.has_unconfigured,
            "sync": scanner.other_master.is_present,
        }
        json_file.write(summary)
    sys.exit(0 if nodes or scanner.has_unconfigured else 1)


def candidates_of(folder: Path | None) -> Iterator[Candidate]:
    """Return the identities of our EDS files and of those in a folder; to match, a file may have faults."""
    files: list[str | Path] = list(eds_names())
    if folder is not None:
        files += sorted(path for path in folder.iterdir() if path.suffix.lower() in (".eds", ".dcf"))
    for name in files:
        file = read_eds(name)
        od = build_od(file, file.integer("DeviceComissioning", "NodeID") or 1)
        identity = Identity(
            device_type=number_at(od, cia.DEVICE_TYPE),
            vendor=number_at(od, cia.IDENTITY, cia.IDENTITY_VENDOR)
            or file.integer("DeviceInfo", "VendorNumber")
            or 0,
            product=number_at(od, cia.IDENTITY, cia.IDENTITY_PRODUCT)
            or file.integer("DeviceInfo", "ProductNumber")
            or 0,
            revision=number_at(od, cia.IDENTITY, cia.IDENTITY_REVISION)
            or file.integer("DeviceInfo", "RevisionNumber")
            or 0,
            serial=number_at(od, cia.IDENTITY, cia.IDENTITY_SERIAL)
            or file.integer("DeviceComissioning", "LSS_SerialNumber")
            or 0,
        )
        yield Candidate(name if isinstance(name, str) else name.name, identity)


def node_table(nodes: Sequence[Found], matches: Mapping[int, Match]) -> Table:
    """Return the nodes as a table."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("node", "state", "vendor:product:revision", "serial", "EDS", "name"):
        table.add_column(name, justify="right" if name == "node" else "left", no_wrap=name != "name")
    for node in nodes:
        serial = node.numbers.get("serial")
        table.add_row(
            str(node.node_id),
            state_text(node),
            ":".join(_hex(node.numbers.get(name)) for name in ("vendor", "product", "revision")),
            "-" if serial is None else str(serial),
            match_text(matches[node.node_id]),
            printable(node.texts.get("name", "-")),
        )
    return table


def state_text(node: Found) -> str:
    """Return the state of a node, with what is odd about it."""
    text = "no heartbeat" if node.state is None else node.state.name.lower().replace("_", "-")
    if not node.answers:
        text += ", no SDO"
    if node.error_register:
        text += f", error 0x{node.error_register:02X}"
    return text


def match_text(found: Match) -> str:
    """Return the EDS of a node as text."""
    names = " or ".join(found.names) or "none"
    return names if found.exact or not found.names else f"{names} (other revision)"


def remarks(scanner: Scanner) -> Iterator[str]:
    """Return what else there is to say."""
    if not scanner.nodes:
        yield NO_NODE
    else:
        yield counted(len(scanner.nodes), "node")
    if scanner.has_unconfigured:
        yield "there are nodes without node-ID; give them one with: skinbus scan assign"
    if scanner.other_master.is_present:
        yield "a master is at work on this bus (it sends SYNC)"


def as_row(node: Found, found: Match) -> dict[str, object]:
    """Return a node for a program."""
    return {
        "node_id": node.node_id,
        "state": None if node.state is None else node.state.name,
        "sdo": node.answers,
        **node.numbers,
        **node.texts,
        "error_register": node.error_register,
        "eds": list(found.names),
        "eds_exact": found.exact,
    }


def _hex(number: int | None) -> str:
    return "-" if number is None else f"{number:X}"
