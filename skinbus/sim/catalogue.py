"""What a scene can name: every effect and layer with its parameters, units and defaults."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from typing import Any, get_type_hints

from skinbus.sim.effects import ORDER, effect_class
from skinbus.sim.laws import LAWS


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter of an effect or a layer."""

    name: str
    unit: str
    text: str
    default: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """One effect or layer: its name as in a scene file, where it acts, what it is, and its parameters."""

    name: str
    stage: str
    text: str
    parameters: tuple[Parameter, ...]


def effects() -> list[Item]:
    """Return all effects, in the order of physics; imports every one of them."""
    classes = [effect_class(name) for name in ORDER]
    return [
        Item(name=cls.name, stage=cls.stage.name.lower(), text=_line(cls), parameters=of(cls))
        for cls in classes
    ]


def layers() -> list[Item]:
    """Return all layer laws."""
    return [
        Item(name=name, stage="law", text=_line(cls), parameters=of(cls))
        for name, cls in sorted(LAWS.items())
    ]


def of(cls: type[Any]) -> tuple[Parameter, ...]:
    """Return the parameters of a class whose fields are described by ``effect.parameter``."""
    hints = get_type_hints(cls, include_extras=True)
    parameters = []
    for field in fields(cls):
        (info,) = hints[field.name].__metadata__
        default = None if field.default is MISSING else field.default
        parameters.append(
            Parameter(name=field.name, unit=info.title or "", text=info.description or "", default=default)
        )
    return tuple(parameters)


def _line(cls: type[Any]) -> str:
    return (cls.__doc__ or "").splitlines()[0]
