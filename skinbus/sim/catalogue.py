"""What a scene can name: every effect and layer with its parameters, units and defaults."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from typing import Any

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
    return [_item(cls, cls.name, cls.stage.name.lower()) for cls in classes]


def layers() -> list[Item]:
    """Return all layer laws."""
    return [_item(cls, name, "law") for name, cls in sorted(LAWS.items())]


def of(cls: type[Any]) -> tuple[Parameter, ...]:
    """Return the parameters of a class whose fields are described by ``effect.parameter``."""
    return tuple(
        Parameter(
            name=field.name,
            unit=field.metadata["title"],
            text=field.metadata["description"],
            default=None if field.default is MISSING else field.default,
        )
        for field in fields(cls)
    )


def _item(cls: type[Any], name: str, stage: str) -> Item:
    text = (cls.__doc__ or "").splitlines()[0]
    return Item(name=name, stage=stage, text=text, parameters=of(cls))
