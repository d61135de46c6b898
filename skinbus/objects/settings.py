"""Settings of one patch on top of its EDS: objects by name or index get a ParameterValue.

::

    "Touch Pa" = 1500                member of a record, when the name is unique in the file
    "Thresholds/Touch Pa" = 1500     the same, in full
    "0x2030:01" = 1500               the same, by index and sub-index (both hexadecimal)
    "Tactel gain" = [1.0, 1.02]      an array, all its elements
    "Healthy tactels" = 0xFFFE       an object without sub-objects
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Final

from skinbus.errors import Fault
from skinbus.objects import cia
from skinbus.objects.eds_file import EdsFile, Entry, Variable
from skinbus.objects.eds_values import TYPES, Number, Value, encode, parse_value

Scalar = bool | int | float | str
Setting = Scalar | tuple[Scalar, ...]
Settings = tuple[tuple[str, Setting], ...]
"""Names and values in a form that can be a key of a cache; see :func:`freeze`."""

NO_SETTINGS: Final[Settings] = ()

_INDEX = re.compile(r"0x(?P<index>[0-9a-f]{4})(?::(?P<sub>[0-9a-f]{1,2}))?", re.IGNORECASE)


def freeze(settings: Mapping[str, Scalar | Sequence[Scalar]]) -> Settings:
    """Return settings as they come from a file in the form that is passed around."""
    return tuple((key, v if isinstance(v, Scalar) else tuple(v)) for key, v in settings.items())


def apply_settings(file: EdsFile, settings: Settings) -> None:
    """Give objects of a file ParameterValues; what cannot be set becomes a fault of the file."""
    for name, setting in settings:
        targets = _targets(file, name)
        if targets is None:
            continue
        if isinstance(setting, tuple) != (len(targets) != 1):
            wanted = "one value" if len(targets) == 1 else f"a list of {len(targets)} values"
            _fault(file, name, setting, wanted)
            continue
        values = setting if isinstance(setting, tuple) else (setting,)
        if len(values) != len(targets):
            _fault(file, name, f"{len(values)} values", f"a list of {len(targets)}")
            continue
        for target, value in zip(targets, values, strict=True):
            _set(file, name, target, value)


def apply_identity(file: EdsFile, serial: int) -> None:
    """Put the serial number of one device into its identity; 0 leaves the file as it is.

    Without one, that of a DCF's commissioning section counts.
    """
    number = serial or file.integer("DeviceComissioning", "LSS_SerialNumber") or 0
    variable = file.variable(cia.IDENTITY, cia.IDENTITY_SERIAL)
    if variable is not None and number:
        variable.value = Value(number)
    elif serial:
        file.faults.append(
            Fault("serial", serial, f"no serial number: no [{cia.IDENTITY:04X}sub4] in the file")
        )


def _targets(file: EdsFile, name: str) -> list[Variable] | None:
    """Return the variables that a name means: one, or all elements of an array; None after a fault."""
    match = _INDEX.fullmatch(name)
    if match:
        found: Entry | Variable | None = file.objects.get(int(match["index"], 16))
        if match["sub"] is not None:
            found = file.variable(int(match["index"], 16), int(match["sub"], 16))
        if found is None:
            _fault(file, name, None, "an object that exists")
            return None
        return _whole(file, name, found)
    matches = _named(file, name)
    if len(matches) == 1:
        return _whole(file, name, matches[0])
    if matches:
        where = " or ".join(f"0x{m.index:04X}:{m.sub:02X}" for m in matches[:4] if isinstance(m, Variable))
        _fault(file, name, None, f"a name of one object; it may be {where}")
    else:
        near = get_close_matches(name, _all_names(file), 3)
        hint = f" such as {' or '.join(repr(n) for n in near)}" if near else ""
        _fault(file, name, None, f"a name in the file{hint}, or an index such as 0x2030:01")
    return None


def _named(file: EdsFile, name: str) -> list[Entry | Variable]:
    group, slash, member = name.partition("/")
    entries = [entry for entry in file.objects.values() if entry.name == (group if slash else name)]
    if slash:
        return [v for e in entries for v in e.variables.values() if e.is_group and v.sub and v.name == member]
    if entries:
        return list(entries)
    groups = [entry for entry in file.objects.values() if entry.is_group]
    return [v for e in groups for v in e.variables.values() if v.sub and v.name == name]


def _all_names(file: EdsFile) -> list[str]:
    members = [v.name for e in file.objects.values() if e.is_group for v in e.variables.values() if v.sub]
    return [entry.name for entry in file.objects.values()] + members


def _whole(file: EdsFile, name: str, found: Entry | Variable) -> list[Variable] | None:
    if isinstance(found, Variable):
        return [found]
    if not found.is_group:
        return [found.variables[0]]
    members = [found.variables[sub] for sub in sorted(found.variables) if sub]
    if len({member.data_type for member in members}) > 1:
        _fault(file, name, None, f"one member of the record, such as {found.name}/{members[0].name}")
        return None
    return members


def _set(file: EdsFile, name: str, target: Variable, value: Scalar) -> None:
    if target.access in ("ro", "const"):
        _fault(file, name, value, f"an object that can be written; [{target.section}] is {target.access}")
        return
    kind = TYPES[target.data_type]
    parsed: Value | str
    if isinstance(value, str):
        parsed = parse_value(value, target.data_type)
    else:
        parsed = _number(value, target.data_type)
    if isinstance(parsed, str):
        _fault(file, name, value, parsed)
    elif kind.is_integer and (why := _outside(target, parsed)):
        _fault(file, name, value, why)
    else:
        target.value = parsed


def _number(value: bool | int | float, data_type: int) -> Value | str:
    kind = TYPES[data_type]
    number: Number = int(value) if isinstance(value, bool) else value
    if isinstance(number, float) and not math.isfinite(number):
        return "a finite number"
    try:
        encode(number, data_type)
    except (ValueError, OverflowError):
        return (
            f"{kind.name}: {kind.low} to {kind.high}" if kind.is_integer else f"a value of type {kind.name}"
        )
    return Value(int(number) if kind.is_integer else number)


def _outside(target: Variable, value: Value) -> str:
    if value.relative or not isinstance(value.number, int):
        return ""
    if target.low is not None and value.number < target.low:
        return f"at least {target.low:g}, the low limit of [{target.section}]"
    if target.high is not None and value.number > target.high:
        return f"at most {target.high:g}, the high limit of [{target.section}]"
    return ""


def _fault(file: EdsFile, name: str, seen: object, wanted: str) -> None:
    file.faults.append(Fault(f'set."{name}"', seen, wanted))
