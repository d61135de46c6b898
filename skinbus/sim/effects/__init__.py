"""The effects a scene may name, by module; one is imported when a scene names an effect of it, not before."""

from __future__ import annotations

from importlib import import_module

from skinbus.sim.effect import Effect

MODULES = {
    # when a sample is taken; where tactels are, how they respond and how loads act
    "mounting": ("sync_jitter", "misplaced", "response", "shear"),
    "readings": (
        # what arrives at the base of the layer
        *("bend", "viscoelastic", "hysteresis"),
        # the film, the matrix, the amplifier
        *("gain_spread", "piezoresistive", "thermal", "drift", "dead", "crosstalk"),
        *("offset", "flicker", "noise", "burst", "saturation"),
        # the converter and what its firmware makes of it
        *("adc", "stuck"),
    ),
    # the boards' oscillators; the boards' own faults, then those of the way
    "traffic": (
        *("clock_drift", "patch_reset", "patch_silent", "bus_off"),
        *("response_jitter", "babbling_node", "corrupt", "delay", "loss"),
    ),
}
ORDER = tuple(name for names in MODULES.values() for name in names)
"""Every effect, in the order in which physics applies those of one stage."""


def effect_class(name: str) -> type[Effect]:
    """Return the parameter class of an effect; imports its module. KeyError for a name that is none."""
    module = {name: module for module, names in MODULES.items() for name in names}[name]
    cls: type[Effect] = vars(import_module(f"skinbus.sim.effects.{module}"))[name.title().replace("_", "")]
    return cls
