"""`skinbus configure`: the patches of an arm get what its files say, verified and stored."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from itertools import groupby

import click
from canopen.objectdictionary import ObjectDictionary, ObjectDictionaryError, ODVariable

from skinbus.cli.console import Console
from skinbus.cli.host import run_to_end
from skinbus.cli.options import Where, arm_bus_options
from skinbus.config.system import load_arm, ods_of
from skinbus.formatting import counted, nodes, span
from skinbus.master.commissioning.sessions import timeouts_of
from skinbus.master.patches.provisioning import Configurer, Provision, Provisioned, expected_nodes
from skinbus.model import Arm
from skinbus.objects import cia

Ods = Mapping[int, ObjectDictionary]
"""Dictionaries of the patches, by node-ID."""


@click.command()
@click.argument("arm")
@arm_bus_options
@click.option("--dry-run", is_flag=True, help="Only say what would change.")
def command(arm: str, where: Where, dry_run: bool) -> None:
    """Write the values of the EDS and DCF files and settings of ARM (a name or a TOML file) into its patches.

    Each patch is reset, so that it holds what it has stored. Every value is read. If it differs, it is
    written, read back and stored (0x1010), where the master finds it at every start. The patches are left
    pre-operational; stop the master first. --dry-run does not reset: what is not stored counts, too.

    Status 0: every patch is as asked. 1: one is absent, refused, not stored, or would change. 2: bad
    file or argument. 3: no bus, or a master is active.

    \b
    Examples:
      skinbus configure forearm -c can0 --dry-run
      skinbus configure my-arm.toml -c can0
    """
    loaded, place = where.of(load_arm(arm))
    ods = dict(zip(loaded.node_id.tolist(), ods_of(loaded), strict=True))
    plans = expected_nodes(loaded, list(ods.values()))
    core = Configurer(plans, dry_run=dry_run, timeouts=timeouts_of(loaded))
    console = Console()
    with console.status(f"configuring {counted(loaded.n_patches, 'patch')} ..."):
        run_to_end(core, place)
    core.other_master.refuse(str(place))
    show(console, loaded, ods, core.results)
    done = len(core.results) == len(ods) and all(result.outcome.is_good for result in core.results.values())
    sys.exit(0 if done else 1)


def show(console: Console, arm: Arm, ods: Ods, results: Mapping[int, Provisioned]) -> None:
    """Print what changed, what went wrong, and a line that sums it up."""
    rows = [(span(node_ids), *change) for change, node_ids in change_rows(ods, results).items()]
    if rows:
        console.table(("nodes", "object", "old", "new"), rows)
    for node_id, result in sorted(results.items()):
        if result.reason or not result.outcome.is_good:
            silent = "no answer: " if result.outcome is Provision.ABSENT else ""
            reason = f" ({silent}{result.reason})" if result.reason else ""
            console.print(f"node {node_id}: {result.outcome}{reason}", style="yellow")
    if restored := [node_id for node_id, result in results.items() if result.is_restored]:
        console.print(f"defaults restored first, a foreign configuration was there: {nodes(restored)}")
    counts = Counter(str(result.outcome) for result in results.values())
    counts["not done"] = arm.n_patches - len(results)
    words = ", ".join(f"{n} {outcome}" for outcome, n in counts.items() if n)
    console.print(f"{arm.name}, {counted(arm.n_patches, 'patch')}: {words}")


def change_rows(ods: Ods, results: Mapping[int, Provisioned]) -> dict[tuple[str, str, str], list[int]]:
    """Return the nodes behind each change (object, old, new); many values of an object are counted."""
    rows: dict[tuple[str, str, str], list[int]] = {}
    for node_id, result in sorted(results.items()):
        od = ods[node_id]
        for index, changes in groupby(result.changes, lambda change: change.index):
            (one, *others) = changes
            where, name = f"0x{index:04X}", getattr(od.get(index), "name", "")
            texts = f"{1 + len(others)} values", ""
            if not others:
                where, variable = f"{where}:{one.sub:02X}", od.get_variable(index, one.sub)
                name = getattr(variable, "name", name)
                texts = value_text(variable, one.old), value_text(variable, one.new)
            rows.setdefault((f"{where} {name}".strip(), *texts), []).append(node_id)
    return rows


def value_text(variable: ODVariable | None, data: bytes | None) -> str:
    """Return a value as text; bytes that do not fit its type as they are."""
    value: object = data
    if data is not None and variable is not None:
        with suppress(ValueError, ObjectDictionaryError):
            value = variable.decode_raw(data)
    match value:
        case None:
            return "?"
        case bytes():
            return value.hex(" ")
        case float():
            return f"{value:.6g}"
        case int() if value > 0xFFFF and variable is not None and variable.index < cia.NMT_STARTUP:
            return f"0x{value:08X}"  # COB-IDs and mappings
    return str(value)
