"""`skinbus scan assign`: node-IDs by LSS, for patches that have none or another."""

from __future__ import annotations

import sys

import click
from rich.text import Text

from skinbus.cli.commands.scan import NO_NODE, candidates_of
from skinbus.cli.console import Console
from skinbus.cli.host import Host
from skinbus.cli.options import arm_bus_options, json_option
from skinbus.cli.output import JsonFile
from skinbus.config.system import load_arm, ods_of
from skinbus.master.commissioning.node_id_assignment import Address, Assigned, Assigner, Assignment, Known
from skinbus.master.patches.provisioning import Identity, expected_node
from skinbus.model import Arm
from skinbus.objects.profile import MASTER_NODE_ID
from skinbus.skin.addresses import find_place, find_places, one_bus

POLL_S = 0.05
UNSAFE_BELOW_MS = 5
"""A time-out shorter than this is lost time on interfaces that deliver frames late."""


@click.command()
@click.argument("arm", required=False)
@arm_bus_options
@click.option(
    "--first",
    type=click.IntRange(1, MASTER_NODE_ID - 1),
    help="Without ARM: node-ID of the first one found; the next ones count up. [default: 1]",
)
@click.option(
    "--timeout-ms",
    default=20,
    show_default=True,
    type=click.IntRange(min=UNSAFE_BELOW_MS, max=1000),
    help="How long a node is given to answer; a scan takes up to 140 of it.",
)
@json_option
def command(
    arm: str | None,
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    bus: str | None,
    first: int | None,
    timeout_ms: int,
    json_file: JsonFile | None,
) -> None:
    """Give node-IDs to the patches of ARM, or to all nodes without one; the nodes store them.

    With ARM (a name or a TOML file), patches that have a serial number there are found by it and get the
    node-ID of the file, even if they have another. All others, and all nodes without ARM, must have no
    node-ID: they are found by fastscan, lowest identity first, and get the free node-IDs in order. To find
    out which board is which, connect those one at a time.

    Status 0: every node found, and every patch with a serial number, has its node-ID. 1: not so, or no node
    is on the bus. 2: bad file or argument. 3: no bus, or a master is active.

    \b
    Examples:
      skinbus scan assign my-arm.toml --channel can0
      skinbus scan assign --first 10 --channel can0
    """
    if arm is not None and first is not None:
        raise click.UsageError("--first is for nodes without an arm file; ARM has the node-IDs itself")
    console = Console()

    def show(result: Assignment) -> None:
        console.print(line(result))

    if arm is not None:
        loaded = one_bus(load_arm(arm), bus)
        known, free, hints = wanted_by(loaded)
        (place,) = find_places(loaded.buses, interface, (channel,) if channel else (), bitrate)
    else:
        known, free = [], list(range(first or 1, MASTER_NODE_ID))
        hints = [_shown(candidate.identity) for candidate in candidates_of(None)]
        place = find_place(interface, channel, bitrate)
    core = Assigner(known=known, free=free, hints=hints, timeout_ns=timeout_ms * 1_000_000, on_result=show)
    with Host(core, place.open) as host:
        host.wait(None, POLL_S)
    core.scanner.other_master.refuse(str(place))
    if not core.results:
        console.print("no node without node-ID answers")
        if not core.scanner.nodes:
            console.print(NO_NODE)
    if core.is_over_full:
        console.print("nodes without node-ID are left, and no free node-ID for them", style="yellow")
    if json_file:
        rows = [
            {
                "node_id": r.node_id,
                "identity": r.address._asdict(),
                "outcome": str(r.outcome),
                "reason": r.reason,
                "old": r.old,
            }
            for r in core.results
        ]
        json_file.write({"nodes": rows})
    done = all(r.outcome.is_good for r in core.results) and not core.is_over_full
    done &= bool(core.results or core.scanner.nodes)
    sys.exit(0 if done else 1)


def wanted_by(arm: Arm) -> tuple[list[Known], list[int], list[tuple[int, ...]]]:
    """Return the patches known by serial number, the other node-IDs, and what is likely of those."""
    known, free, hints = [], [], []
    for placed, od in zip(arm.patches, ods_of(arm), strict=True):
        identity = expected_node(placed.node_id, od).identity
        if identity.serial:
            address = Address(identity.vendor, identity.product, identity.revision, identity.serial)
            known.append(Known(address, placed.node_id))
        else:
            free.append(placed.node_id)
            hints.append(_shown(identity))
    return known, free, hints


def line(result: Assignment) -> Text:
    """Return one line, its outcome in colour."""
    colour = (
        "green" if result.outcome.is_good else "yellow" if result.outcome is Assigned.NOT_STORED else "red"
    )
    reason = f" ({result.reason})" if result.reason else ""
    return Text.assemble(
        f"{result.address} -> node {result.node_id}: ", (str(result.outcome), colour), reason
    )


def _shown(identity: Identity) -> tuple[int, ...]:
    """Return what is known of an identity beforehand, all but the serial number."""
    return (identity.vendor, identity.product, identity.revision)
