"""Tables of a TOML file to frozen parameter classes; every fault is collected, none is raised."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from skinbus.config.wording import faults_of
from skinbus.errors import Fault

T = TypeVar("T")


def read(cls: type[T], table: Any, key: str, faults: list[Fault]) -> T | None:
    """Return an instance of ``cls`` with the values of a table, or None after adding its faults."""
    try:
        # by way of JSON, where pydantic's strict mode takes an array for a tuple but no string for a number
        adapter = _adapter(cls)  # type: ignore[arg-type]  # a class is hashable
        value: T = adapter.validate_json(json.dumps(table, default=str))
        return value
    except ValidationError as error:
        faults.extend(faults_of(error.errors(include_url=False), key, known(cls)))
        return None


def read_rest(
    cls: type[T], table: Any, key: str, faults: list[Fault], stand_ins: dict[str, Any]
) -> tuple[T | None, frozenset[str]]:
    """As :func:`read`; of a table with faults return what is left of it, to be looked at further.

    stand_ins: values in place of faulty or missing ones that have no default
    Return the instance, None where nothing is left, and the names that are faulty.
    """
    own: list[Fault] = []
    value = read(cls, table, key, own)
    faults.extend(own)
    if value is not None or not isinstance(table, dict):
        return value, frozenset()
    faulty = frozenset(fault.key.removeprefix(f"{key}.").partition("[")[0].partition(".")[0] for fault in own)
    rest = {name: value for name, value in table.items() if name not in faulty}
    return read(cls, rest | {name: stand_ins[name] for name in faulty & {*stand_ins}}, key, []), faulty


@cache
def _adapter(cls: Any) -> TypeAdapter[Any]:
    return TypeAdapter(cls)


def known(cls: type[Any]) -> Sequence[str]:
    """Return the names of the parameters of a class."""
    return [field.name for field in fields(cls)]
