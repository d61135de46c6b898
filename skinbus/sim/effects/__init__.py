"""The effects a scene may name; each is imported when a scene names it, and not before."""

from __future__ import annotations

from importlib import import_module
from typing import Final

from skinbus.sim.effect import Effect

ORDER: Final = (
    # when a sample is taken
    "sync_jitter",
    # where tactels are and how large
    "misplaced",
    "disc_area",
    "response",
    "shear",
    # what arrives at the base of the layer
    "bend",
    "viscoelastic",
    "hysteresis",
    # the film, the matrix, the amplifier
    "gain_spread",
    "piezoresistive",
    "thermal",
    "drift",
    "dead",
    "crosstalk",
    "offset",
    "flicker",
    "noise",
    "burst",
    "saturation",
    # the converter and what its firmware makes of it
    "adc",
    "stuck",
    # the boards' oscillators
    "clock_drift",
    # the traffic: the boards' own faults first, then those of the way
    "patch_reset",
    "patch_silent",
    "bus_off",
    "cable",
    "response_jitter",
    "babbling_node",
    "corrupt",
    "delay",
    "loss",
)
"""Every effect, in the order in which physics applies those of one stage."""


def effect_class(name: str) -> type[Effect]:
    """Return the parameter class of an effect; imports its module. KeyError for a name that is none."""
    if name not in ORDER:
        raise KeyError(name)
    cls: type[Effect] = vars(import_module(f"skinbus.sim.effects.{name}"))[name.title().replace("_", "")]
    assert issubclass(cls, Effect)
    return cls
