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

from skinbus.objects import cia
from skinbus.objects.eds_file import EdsFile, Entry, Variable
from skinbus.objects.eds_values import TYPES, Value, encode, parse_value

Scalar = bool | int | float | str
Setting = Scalar | tuple[Scalar, ...]
Settings = tuple[tuple[str, Setting], ...]
"""Names and values in a form that can be a key of a cache; see :func:`freeze`."""

NO_SETTINGS: Settings = ()

_INDEX = re.compile(r"0x(?P<index>[0-9a-f]{4})(?::(?P<sub>[0-9a-f]{1,2}))?", re.IGNORECASE)


def freeze(settings: Mapping[str, Scalar | Sequence[Scalar]]) -> Settings:
    """Return settings as they come from a file in the form that is passed around."""
    return tuple((key, v if isinstance(v, Scalar) else tuple(v)) for key, v in settings.items())


def apply_settings(file: EdsFile, settings: Settings) -> None:
    """Give objects of a file ParameterValues; what cannot be set becomes a fault of the file."""
    objects: dict[str, list[list[Variable]]] = {}
    members: dict[str, list[list[Variable]]] = {}
    for entry in file.objects.values() if settings else ():
        objects.setdefault(entry.name, []).append(_variables(entry))
        for variable in _variables(entry) if entry.is_group else ():
            for name in (variable.name, f"{entry.name}/{variable.name}"):
                members.setdefault(name, []).append([variable])
    named = members | objects
    for name, setting in settings:
        values = setting if isinstance(setting, tuple) else (setting,)
        match = _INDEX.fullmatch(name)
        found = _at(file, match) if match else named.get(name, [])
        targets = found[0] if len(found) == 1 else []
        seen: object = None
        if match and not found:
            wanted = "an object that exists"
        elif not found:
            near = get_close_matches(name, [n for n in named if "/" not in n], 3)
            hint = f" such as {' or '.join(repr(n) for n in near)}" if near else ""
            wanted = f"a name in the file{hint}, or an index such as 0x2030:01"
        elif len(found) > 1:
            where = " or ".join(f"0x{v.index:04X}:{v.sub:02X}" for v, *_ in found[:4])
            wanted = f"a name of one object; it may be {where}"
        elif len(values) != len(targets) or isinstance(setting, tuple) != (len(targets) != 1):
            seen, wanted = setting, "one value" if len(targets) == 1 else f"a list of {len(targets)} values"
        else:
            for target, value in zip(targets, values, strict=True):
                _set(file, name, target, value)
            continue
        _fault(file, name, seen, wanted)


def apply_identity(file: EdsFile, serial: int) -> None:
    """Put the serial number of one device into its identity; 0 leaves the file as it is.

    Without one, that of a DCF's commissioning section counts.
    """
    number = serial or file.integer("DeviceComissioning", "LSS_SerialNumber") or 0
    variable = file.variable(cia.IDENTITY, cia.IDENTITY_SERIAL)
    if variable is not None and number:
        variable.value = Value(number)
    elif serial:
        wanted = f"no serial number: no [{cia.IDENTITY:04X}sub4] in the file"
        file.faults.add("serial", serial, wanted)


def _at(file: EdsFile, match: re.Match[str]) -> list[list[Variable]]:
    """Return the variables that an index, with or without a sub-index, means."""
    entry = file.objects.get(int(match["index"], 16))
    if entry is None:
        return []
    if match["sub"] is None:
        return [_variables(entry)]
    variable = entry.variables.get(int(match["sub"], 16))
    return [[variable]] if variable else []


def _variables(entry: Entry) -> list[Variable]:
    """Return the variable of an object, or the elements of a group."""
    return [variable for sub, variable in sorted(entry.variables.items()) if sub or not entry.is_group]


def _set(file: EdsFile, name: str, target: Variable, value: Scalar) -> None:
    if target.access in ("ro", "const"):
        _fault(file, name, value, f"an object that can be written; [{target.section}] is {target.access}")
        return
    parsed = parse_value(value, target.data_type) if isinstance(value, str) else _number(value, target)
    if isinstance(parsed, str):
        _fault(file, name, value, parsed)
    else:
        target.value = parsed  # its limits are looked at with those of the file


def _number(value: bool | int | float, target: Variable) -> Value | str:
    """Return a number as a value of its target, or, as text, what was wanted instead."""
    kind = TYPES[target.data_type]
    if isinstance(value, float) and not math.isfinite(value):
        return "a finite number"
    try:
        encode(value, target.data_type)
    except (ValueError, OverflowError):
        limits = f"{kind.name}: {kind.low} to {kind.high}"
        return limits if kind.is_integer else f"a value of type {kind.name}"
    return Value(int(value) if kind.is_integer else value)


def _fault(file: EdsFile, name: str, seen: object, wanted: str) -> None:
    file.faults.add(f'set."{name}"', seen, wanted)
