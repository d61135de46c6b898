"""Tables of a TOML file to frozen parameter classes; every fault is collected, none is raised."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

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
        faults.extend(_fault(cls, key, detail) for detail in error.errors())
        return None


@cache
def _adapter(cls: Any) -> TypeAdapter[Any]:
    return TypeAdapter(cls)


def _fault(cls: type[Any], key: str, detail: Any) -> Fault:
    where = key + "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in detail["loc"])
    seen, wanted = detail["input"], detail["msg"][0].lower() + detail["msg"][1:]
    match detail["type"]:
        case "unexpected_keyword_argument" | "extra_forbidden":
            wanted = f"no such key; known are {', '.join(known(cls)) or 'none'}"
        case "missing" | "missing_argument" | "missing_keyword_only_argument":
            seen, wanted = None, "a value; it has no default"
        case "dataclass_type" | "dataclass_exact_type":
            wanted = "a table"
        case _:
            wanted = wanted.removeprefix("input should be ")
    return Fault(where, seen, wanted)


def known(cls: type[Any]) -> Sequence[str]:
    """Return the names of the parameters of a class."""
    return [field.name for field in fields(cls)]
