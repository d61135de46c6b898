"""The effects a scene may name; each is imported when a scene names it, and not before."""

from __future__ import annotations

from importlib import import_module
from typing import Final

from skinbus.sim.effect import Effect

ORDER: Final[tuple[str, ...]] = ()
"""Every effect, in the order in which physics applies those of one stage."""


def effect_class(name: str) -> type[Effect]:
    """Return the parameter class of an effect; imports its module. KeyError for a name that is none."""
    if name not in ORDER:
        raise KeyError(name)
    cls: type[Effect] = vars(import_module(f"skinbus.sim.effects.{name}"))[name.title().replace("_", "")]
    assert issubclass(cls, Effect)
    return cls
