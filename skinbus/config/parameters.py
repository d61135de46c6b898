"""Tables of a TOML file to frozen parameter classes; every fault is collected, none is raised."""

from __future__ import annotations

import json
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
        known = [field.name for field in fields(cls)]  # type: ignore[arg-type]  # it is a dataclass
        faults.extend(faults_of(error.errors(include_url=False), key, known))
        return None


@cache
def _adapter(cls: Any) -> TypeAdapter[Any]:
    return TypeAdapter(cls)
