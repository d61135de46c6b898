"""Arm files: TOML to checked tables of links and placed patches; every fault of a file at once.

Only what is in the file itself is checked here. What depends on the boards (their size, their bus
load) is checked where their EDS files are known, in ``objects.arm``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from skinbus.config.arm_tables import (
    SURFACES,
    ArmTable,
    BusTable,
    LinkTable,
    MeshTable,
    PatchTable,
    RingTable,
    Table,
    beside,
    is_path,
)
from skinbus.config.guard_tables import GuardTable, RegionTable, check_regions
from skinbus.config.placement import Mounting, mount
from skinbus.config.robot_tables import JointTable, RobotTable, robot_settings
from skinbus.config.toml_file import find_toml, read_toml
from skinbus.config.wording import faults_of, nearest
from skinbus.errors import Fault, FaultList
from skinbus.model.arm import BusSettings
from skinbus.model.robot import RobotSettings

MAX_LINKS = 16
"""A contact's TPDO has four bits for its link."""

MAX_BUSES = 16
"""More than a controller has sockets for adapters."""

DEFAULT_DATA_BITRATE = 2_000_000
"""Of CAN FD, bit/s: what any transceiver for CAN FD does, on any wiring that does 1 Mbit/s."""

MAX_SHOWN = 64
"""Names that a fault lists, more than links and buses."""

_FOLDER = Path(__file__).parent / "arms"

_MODELS: dict[str, type[Table]] = {
    "bus": BusTable,
    "link": LinkTable,
    "patch": PatchTable,
    "ring": RingTable,
    "joint": JointTable,
}
"""Of arrays of tables."""

_TABLES = sorted(["arm", "guard", "robot", *_MODELS])


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmFile:
    """A file, read: everything in it that made sense, and every fault of the rest."""

    path: Path
    name: str
    buses: tuple[BusSettings, ...]
    links: tuple[LinkTable, ...]
    mountings: tuple[Mounting, ...]
    """Those of the first bus come first, and so on."""
    robot: RobotSettings | None
    guard: GuardTable | None
    faults: FaultList

    @property
    def files(self) -> tuple[Path, ...]:
        """This file and those that it names, each once: of boards, of the robot, of meshes."""
        names = [eds for mounting in self.mountings if is_path(eds := mounting.board.eds)]
        names += [link.mesh for link in self.links if isinstance(link, MeshTable)]
        if self.robot:
            names.append(self.robot.urdf)
        found = [self.path, *(beside(name, self.path) for name in names)]
        return tuple(dict.fromkeys(file.resolve() for file in found))


def find_arm(name_or_path: str | Path) -> Path:
    """Return the file behind the name of a shipped arm, or a path.

    Raises:
        ConfigError: there is no such file; the message lists the names known.
    """
    return find_toml(name_or_path, _FOLDER, "arm")


def read_arm_file(path: Path) -> ArmFile:
    """Return what an arm file says, and its faults.

    Raises:
        ConfigError: it is not TOML at all.
    """
    return check_tables(read_toml(path), path)


def check_tables(tables: dict[str, Any], path: Path) -> ArmFile:
    """Return what the tables of an arm file say, and their faults; never raises for what is in them."""
    faults = FaultList(
        Fault(key, None, f"one of {', '.join(_TABLES)}{nearest(key, _TABLES)}")
        for key in tables
        if key not in _TABLES
    )
    arm = _check(ArmTable, tables.get("arm", {}), "arm", faults)
    checked = {kind: list(_check_all(tables, kind, faults)) for kind in _MODELS}
    for kind, most in (("bus", MAX_BUSES), ("link", MAX_LINKS)):
        if (n := len(checked[kind])) > most:
            faults.add(kind, f"{n} tables", f"at most {most}")
    links = checked["link"]
    for kind in ("bus", "link", "joint"):
        _check_unique("name", [(key, table.name) for key, table in checked[kind]], faults)
    channels = [(key, (bus.interface, bus.channel)) for key, bus in checked["bus"] if bus.channel]
    _check_unique("channel", channels, faults)
    if not tables.get("link"):
        faults.add("link", None, "at least one [[link]]")
    if not tables.get("patch") and not tables.get("ring"):
        faults.add("patch", None, "at least one [[patch]] or [[ring]]")
    robot = _check(RobotTable, tables["robot"], "robot", faults) if "robot" in tables else None
    carrier = None
    if robot is not None or "robot" not in tables:  # one with faults of its own is reported there
        rate_hz = arm.rate_hz if arm else 1.0  # an arm without it is refused
        carrier = robot_settings(robot, checked["joint"], links, rate_hz, path, faults)
    named = {link.name: (i, link) for i, (_, link) in enumerate(links)}
    bus_names = _names(tables, "bus")
    mountings = mount(checked["patch"], checked["ring"], named, _names(tables, "link"), bus_names, faults)
    if not faults:
        for k in {*range(len(bus_names))} - {mounting.bus for mounting in mountings}:
            faults.add(f"bus[{k + 1}].name", bus_names[k], "a bus with patches")
    _check_unique("node_id", [(m.key, (m.bus, m.board.node_id)) for m in mountings], faults)
    guard = _check(GuardTable, tables["guard"], "guard", faults) if "guard" in tables else None
    if guard:
        node_ids = [] if faults else [mounting.board.node_id for mounting in mountings]
        _check_unique("name", [(key, region.name) for key, region in guard.regions], faults)
        check_regions(guard, _names(tables, "link"), node_ids, faults)
    return ArmFile(
        path=path,
        name=arm.name if arm else "",
        buses=_buses(arm or ArmTable(name="?"), checked["bus"]),
        links=tuple(link for _, link in links),
        mountings=tuple(mountings),
        robot=carrier,
        guard=guard,
        faults=faults,
    )


def _tables(tables: dict[str, Any], kind: str) -> list[Any]:
    found = tables.get(kind, [])
    return found if isinstance(found, list) else [found]


def _names(tables: dict[str, Any], kind: str) -> list[Any]:
    """Return the first names as they are written, those of tables that have faults among them."""
    return [table.get("name") for table in _tables(tables, kind)[:MAX_SHOWN] if isinstance(table, dict)]


def _check(model: type[Table], table: Any, key: str, faults: FaultList) -> Any:
    """Return the checked table, or None and its faults."""
    try:
        return model.model_validate(table)
    except ValidationError as error:
        known = [*model.model_fields], [*RegionTable.model_fields]  # only [guard] has tables in it
        faults += faults_of(error.errors(include_url=False), key, *known)
        return None


def _check_all(tables: dict[str, Any], kind: str, faults: FaultList) -> Iterator[tuple[str, Any]]:
    """Yield the checked tables of an array of tables with their keys, numbered from 1."""
    for i, table in enumerate(_tables(tables, kind), 1):
        key, model = f"{kind}[{i}]", _MODELS[kind]
        if kind == "link" and isinstance(table, dict):
            surface = table.get("surface")
            if str(surface) not in SURFACES:
                faults.add(f"{key}.surface", surface, f"one of {', '.join(SURFACES)}")
                continue
            model = SURFACES[str(surface)]
        if (checked := _check(model, table, key, faults)) is not None:
            yield key, checked


def _check_unique(name: str, values: Sequence[tuple[str, Any]], faults: FaultList) -> None:
    """Add a fault for each value, of a table's key, that an earlier one has; of pairs the last is shown."""
    seen: dict[Any, str] = {}
    for key, value in values:
        owner = seen.setdefault(value, key)
        if owner != key:
            shown = value[-1] if isinstance(value, tuple) else value
            faults.add(f"{key}.{name}", shown, f"another: {owner} has it")


def _buses(arm: ArmTable, buses: list[tuple[str, BusTable]]) -> tuple[BusSettings, ...]:
    """Return the buses of the file; one without a name when it names none."""
    found = []
    for said in [bus.model_dump(exclude_none=True) for _, bus in buses] or [{}]:
        both = {**arm.model_dump(exclude_none=True), "name": "", **said}
        both.setdefault("data_bitrate", DEFAULT_DATA_BITRATE)
        if not both.pop("canfd"):
            both["data_bitrate"] = None
        found.append(BusSettings(**both))
    return tuple(found)
