"""Options that several commands share."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import reduce, wraps
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import click

from skinbus.model import Arm, BusSettings
from skinbus.skin import addresses
from skinbus.skin.addresses import BusAddress

DEFAULT_BITRATE = 1_000_000

INPUT = click.Path(dir_okay=False, path_type=Path)
"""Kind of a file that a command reads; its reader refuses one that is none."""


class Range(click.FloatRange):
    """A number within bounds; infinity and what is not a number are none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Refuse what is not finite; no bound does: every comparison with it is false."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


POSITIVE = Range(min=0.0, min_open=True)


def file_option(*names: str, **settings: Any) -> Callable[..., Any]:
    """Return an option that names a file; ``settings`` are those of click."""
    return click.option(*names, type=INPUT, **settings)


class Where(NamedTuple):
    """Buses as the command line names them."""

    interface: str | None = None
    channels: tuple[str, ...] = ()
    bitrate: int | None = None
    names: tuple[str, ...] = ()

    def places(self, *buses: BusSettings) -> list[BusAddress]:
        """Return where the buses of an arm are, or that of no arm file."""
        return addresses.find_places(buses or (BusSettings(),), self.interface, self.channels, self.bitrate)

    def words(self) -> dict[str, Any]:
        """Return what ``skinbus.listen`` is to be given."""
        return {"interface": self.interface, "channel": self.channels, "bitrate": self.bitrate}

    def of(self, arm: Arm) -> tuple[Arm, BusAddress]:
        """Return the part of an arm on one bus, and where the bus is."""
        part = addresses.one_bus(arm, self.names)
        return part, self.places(*part.buses)[0]


channels_option = click.option(
    "-c",
    "--channel",
    "channels",
    multiple=True,
    help="Channel of the interface, or interface in a log: one for each bus in the order of the arm file, or "
    "NAME=CHANNEL. By default that of the arm file; without one, for a single bus, can0 (239.74.163.2 with "
    "udp_multicast), or the only one in the log.",
)
_BUS_OPTIONS = (
    click.option(
        "--interface", help="python-can interface: socketcan (default), virtual, udp_multicast, slcan, ..."
    ),
    channels_option,
    click.option(
        "--bitrate",
        type=click.IntRange(10_000, 1_000_000),
        help="Bit/s, if the interface can set it (default: that of the arm file, or 1000000).",
    ),
    click.option("--bus", "names", multiple=True, help="Name of the bus, when the arm has several."),
)


def _bus_options(*options: Any) -> Callable[..., Any]:
    """Return what adds options of buses to a command and hands them to it as one argument."""

    def add(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def joined(**given: Any) -> Any:
            where = Where(**{key: given.pop(key) for key in Where._fields if key in given})
            return command(where=where, **given)

        return reduce(lambda added, option: option(added), reversed(options), joined)

    return add


bus_options = _bus_options(*_BUS_OPTIONS[:3])
"""Add --interface, --channel and --bitrate; the command gets them as ``where: Where``."""
arm_bus_options = _bus_options(*_BUS_OPTIONS)
"""Add the same and --bus."""

LEVELS = ("kmeans", "fit", "full")
"""Names of the estimator's levels, without its imports; a test holds both lists equal."""
DEFAULT_LEVEL = "fit"
"""The estimator's own, held equal by the same test."""


def level_option(what: str = "Level of the estimator.") -> Callable[..., Any]:
    """Return --level."""
    choice = click.Choice(LEVELS)
    return click.option("--level", default=DEFAULT_LEVEL, type=choice, help=what)


seconds_option = click.option("--seconds", type=POSITIVE, help="Stop after this time, s.")

zero_option = click.option("--zero", is_flag=True, help="Take the first readings of each patch as its zero.")


def function_named(value: str) -> Callable[[], Any]:
    """Return the function that MODULE:FUNCTION names; modules are looked for here first, as by python -m."""
    module, _, name = value.partition(":")
    if not (module and name):
        raise click.BadParameter(f"{value!r} is no function: wanted MODULE:FUNCTION, such as my_sensor:read")
    sys.path.insert(0, "")
    try:
        found: Callable[[], Any] = getattr(import_module(module), name)
    except Exception as error:  # a module of the user may raise anything
        raise click.BadParameter(f"{value}: {error}") from error
    if not callable(found):
        raise click.BadParameter(f"{value} is of type {type(found).__name__}; wanted a function")
    return found
