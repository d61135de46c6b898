"""Presses of an arm of several buses: `--bus` or a column `bus` says of which bus the node-IDs are."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from skinbus.cli.press_csv import names_of, read_presses, rows_of
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.estimate.presses.kinds import Press
from skinbus.model import Arm
from skinbus.skin.addresses import bus_numbers


def read_bus_presses(arm: Arm, path: Path, bus: str | None) -> list[Press]:
    """Return the presses in a file, with patches of the whole arm; ``bus`` names the bus of all rows.

    A column `bus` names it row by row; a file has rows of one bus where node-IDs repeat.

    Raises:
        AddressError: the arm has no such bus.
        ConfigError: faults of the file, all of them; keys are line and column.
    """
    (only,) = bus_numbers(arm, [bus]) if bus else (None,)
    if len(arm.buses) == 1:
        return read_presses(arm, path)
    known = [settings.name for settings in arm.buses]
    said = _named(path)
    faults = FaultList()
    for line, name in said.items():
        if name not in known:
            faults.append(Fault(f"line {line}, bus", name or None, " or ".join(known)))
        elif bus and name != bus:
            faults.append(Fault(f"line {line}, bus", name, f"{bus}, as --bus says"))
    repeat = len(np.unique(arm.node_id)) < arm.n_patches
    names = sorted({*said.values()})
    if repeat and not bus and len(names) > 1:
        wanted = "a file for each bus, as node-IDs repeat from bus to bus"
        faults.append(Fault("column bus", ", ".join(names), wanted))
    elif repeat and not bus and not names:
        faults.append(Fault("column bus", None, "it, or --bus, as node-IDs repeat: " + " or ".join(known)))
    if faults:
        raise ConfigError(str(path), faults)
    if only is None and len(names) == 1:
        only = known.index(names[0])
    if only is not None:
        first = arm.patches_on(only).start
        return [press._replace(patch=first + press.patch) for press in read_presses(arm.part(only), path)]
    presses = read_presses(arm, path)
    for press in presses:
        own = known[arm.patches[press.patch].bus]
        if said.get(press.line, own) != own:
            node = f"{own}, which has node {arm.node_id[press.patch]}"
            faults.append(Fault(f"line {press.line}, bus", said[press.line], node))
    if faults:
        raise ConfigError(str(path), faults)
    return presses


def _named(path: Path) -> dict[int, str]:
    """Return what the column `bus` says, by line; nothing without one."""
    rows = rows_of(path)
    try:
        if "bus" not in names_of(rows):
            return {}
        lines = ((rows.line_num, (row["bus"] or "").strip()) for row in rows)
        return dict(lines)
    except csv.Error:
        return {}  # ``read_presses`` names the line
