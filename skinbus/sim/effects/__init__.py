"""The effects a scene may name, by module; one is imported when a scene names an effect of it, not before."""

from __future__ import annotations

from importlib import import_module

from skinbus.sim.effect import STAGE_OF, Effect, Stage

MODULES = {Stage.GEOMETRY: "mounting", Stage.COUNTS: "readings", Stage.FRAMES: "traffic"}
"""Each with all stages after the one before it, up to this one."""


def effect_class(name: str) -> type[Effect]:
    """Return the parameter class of an effect; imports its module. KeyError for a name that is none."""
    module = next(module for last, module in MODULES.items() if STAGE_OF[name] <= last)
    cls: type[Effect] = vars(import_module(f"skinbus.sim.effects.{module}"))[name.title().replace("_", "")]
    return cls
