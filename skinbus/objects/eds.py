"""Object dictionaries from EDS and DCF files: found by name or path, checked, resolved for one node-ID.

The ``canopen`` package's classes hold the result, so its SDO client and everybody's tools take it. Its
file reader is not used: it turns octal numbers, REAL32 bit patterns, ``$NODEID`` alone and the values of
compact arrays into None, and raises on files that are not UTF-8 (canopen 2.4.1, objectdictionary/eds.py).
"""

from __future__ import annotations

import os
import pickle
from functools import cache
from pathlib import Path

from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable

from skinbus.errors import EdsError
from skinbus.objects import cia
from skinbus.objects.eds_file import RECORD, EdsFile, Entry, Variable, read_file
from skinbus.objects.eds_lint import lint
from skinbus.objects.settings import NO_SETTINGS, Settings, apply_identity, apply_settings

_PACKAGE = Path(__file__).parent.parent


def load_eds(
    name_or_path: str | Path, node_id: int, *, settings: Settings = NO_SETTINGS, serial: int = 0
) -> ObjectDictionary:
    """Return the object dictionary that an EDS or DCF file describes, as it is on node ``node_id``.

    A name without suffix is one of the files that ship with skinbus; see :func:`eds_names`.
    Each call gives a dictionary of its own; the file is read and checked once.

    ParameterValues, of a DCF or from ``settings``, are in ``variable.value``, the values at power-on in
    ``variable.default``. Where nobody can write, a ParameterValue says what the device is: it is both.

    Args:
        settings: ParameterValues on top of the file; see ``objects.settings``.
        serial: serial number of the device that is expected, 0 for any.

    Raises:
        EdsError: no such file, or faults in it or in the settings, all of them.
        ValueError: the node-ID is not 1..127.
    """
    if not 1 <= node_id <= cia.MAX_NODE_ID:
        raise ValueError(f"node_id is {node_id}; wanted 1..{cia.MAX_NODE_ID}")
    path = find_eds(name_or_path)
    template: _Template = pickle.loads(_compile(path, path.stat().st_mtime_ns, settings, serial))
    if template.commissioned not in (0, node_id):
        key, wanted = "[DeviceComissioning] NodeID", f"{node_id}, the node it is for"
        raise EdsError.of(path, key, template.commissioned, wanted)
    return template.at(node_id)


def eds_names() -> list[str]:
    """Return the names of the EDS files that ship with skinbus."""
    return sorted(path.stem for path in _folder().glob("*.eds"))


def find_eds(name_or_path: str | Path) -> Path:
    """Return the file behind a name or path.

    Raises:
        EdsError: there is no such file; the message lists the names known.
    """
    path = Path(name_or_path)
    if path.suffix == "" and path.name == str(name_or_path):
        path = _folder() / f"{path.name}.eds"
    if not os.path.isfile(path):
        known = ", ".join(eds_names())
        wanted = f"an EDS or DCF file that can be read, or one of {known}"
        raise EdsError.of(name_or_path, "EDS", None, wanted)
    return path.resolve()


def read_eds(name_or_path: str | Path) -> EdsFile:
    """Return the file as typed entries; its faults are in the result, checked against the rules or not.

    Raises:
        EdsError: there is no such file.
    """
    return read_file(find_eds(name_or_path))


def build_od(file: EdsFile, node_id: int) -> ObjectDictionary:
    """Return the object dictionary of a file already read; faulty values are None in it."""
    return _Template(file).at(node_id)


def _folder() -> Path:
    """Return the folder of our EDS files: in the package when installed, beside it in a checkout."""
    inside = _PACKAGE / "eds"
    return inside if inside.is_dir() else _PACKAGE.parent / "eds"


@cache
def _compile(path: Path, _mtime_ns: int, settings: Settings, serial: int) -> bytes:
    """Return the pickled template of a file without faults; copying a pickle is ten times faster."""
    file = read_file(path)
    apply_settings(file, settings)
    apply_identity(file, serial)
    faults = lint(file)
    if faults:
        raise EdsError(str(path), faults)
    return pickle.dumps(_Template(file))


class _Template:
    """An object dictionary not yet resolved for a node, and the values that depend on the node-ID."""

    def __init__(self, file: EdsFile) -> None:
        self.od: ObjectDictionary = ObjectDictionary()  # type: ignore[no-untyped-call]
        self.relative: list[tuple[int, int, str, int]] = []
        for entry in file.objects.values():
            self._add(entry)
        self.commissioned = file.integer("DeviceComissioning", "NodeID") or 0
        """Node-ID that a DCF is for; 0 for any."""
        info = self.od.device_information
        info.LSS_supported = bool(file.integer("DeviceInfo", "LSS_Supported"))
        rates = (10, 20, 50, 125, 250, 500, 800, 1000)
        info.allowed_baudrates |= {1000 * k for k in rates if file.integer("DeviceInfo", f"BaudRate_{k}")}

    def at(self, node_id: int) -> ObjectDictionary:
        """Return the dictionary resolved for a node; it is the template's own, not a copy."""
        self.od.node_id = node_id
        for index, sub, field, offset in self.relative:
            setattr(self.od.get_variable(index, sub), field, offset + node_id)
        return self.od

    def _add(self, entry: Entry) -> None:
        if not entry.is_group:
            self.od.add_object(self._variable(entry.variables[0]))
            return
        group = (ODRecord if entry.object_type == RECORD else ODArray)(entry.name, entry.index)
        for sub in sorted(entry.variables):
            group.add_member(self._variable(entry.variables[sub]))
        self.od.add_object(group)

    def _variable(self, source: Variable) -> ODVariable:
        variable = ODVariable(source.name, source.index, source.sub)
        variable.data_type = source.data_type
        variable.access_type = source.access
        variable.pdo_mappable = source.mappable
        variable.min, variable.max = source.low, source.high  # type: ignore[assignment]  # REAL limits
        is_fixed = source.access in ("ro", "const")
        default = (source.value if is_fixed else None) or source.default
        variable.relative = default is not None and default.relative
        for field, value in (("default", default), ("value", source.value)):
            if value is not None and value.relative and isinstance(value.number, int):
                self.relative.append((source.index, source.sub, field, value.number))
            elif value is not None:
                setattr(variable, field, value.number)
        return variable
