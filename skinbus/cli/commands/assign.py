"""`skinbus scan assign`: node-IDs by LSS, for patches that have none or another."""

from __future__ import annotations

import sys

import click

from skinbus.cli.commands.scan import NO_NODE
from skinbus.cli.console import Console
from skinbus.cli.host import run_to_end
from skinbus.cli.options import Where, arm_bus_options
from skinbus.config.system import load_arm, ods_of
from skinbus.master.commissioning.node_id_assignment import Address, Assigner, Assignment, Known
from skinbus.master.patches.provisioning import expected_node
from skinbus.model import Arm
from skinbus.objects.profile import MASTER_NODE_ID


@click.command()
@click.argument("arm", required=False)
@arm_bus_options
@click.option(
    "--timeout-ms",
    default=20,
    type=click.IntRange(5, 1000),
    help="How long a node is given to answer; a scan takes up to 140 of it.",
)
def command(arm: str | None, where: Where, timeout_ms: int) -> None:
    """Give node-IDs to the patches of ARM, or to all nodes without one; the nodes store them.

    With ARM (a name or a TOML file), patches with a serial number in it are found by that number and get
    the node-ID of the file, even if they have another. All others, and all nodes without ARM, must have no
    node-ID: they are found by fastscan, lowest identity first, and get the free node-IDs in order. To find
    out which board is which, connect those one at a time.

    Status 0: every node found, and every patch with a serial number, has its node-ID. 1: some have not, or
    no node is on the bus. 2: bad file or argument. 3: no bus, or a master is active.

    \b
    Examples:
      skinbus scan assign my-arm.toml -c can0
      skinbus scan assign -c can0
    """
    console = Console()
    if arm is None:
        known: list[Known] = []
        free, place = [*range(1, MASTER_NODE_ID)], where.places()[0]
    else:
        part, place = where.of(load_arm(arm))
        known, free = wanted_by(part)
    core = Assigner(
        known=known,
        free=free,
        timeout_ns=timeout_ms * 1_000_000,
        on_result=lambda result: console.print(line(result)),
    )
    run_to_end(core, place)
    core.scanner.other_master.refuse(str(place))
    if not core.results:
        console.print("no node without node-ID answers")
        if not core.scanner.nodes:
            console.print(NO_NODE)
    if core.is_over_full:
        console.print("nodes without node-ID are left, and no free node-ID for them", style="yellow")
    done = all(result.outcome.is_good for result in core.results) and not core.is_over_full
    sys.exit(0 if done and (core.results or core.scanner.nodes) else 1)


def wanted_by(arm: Arm) -> tuple[list[Known], list[int]]:
    """Return the patches known by serial number, and the other node-IDs."""
    known, free = [], []
    for placed, od in zip(arm.patches, ods_of(arm), strict=True):
        identity = expected_node(placed.node_id, od).identity
        if identity.serial:
            address = Address(identity.vendor, identity.product, identity.revision, identity.serial)
            known.append(Known(address, placed.node_id))
        else:
            free.append(placed.node_id)
    return known, free


def line(result: Assignment) -> str:
    """Return one line."""
    reason = f" ({result.reason})" if result.reason else ""
    return f"{result.address} -> node {result.node_id}: {result.outcome}{reason}"
