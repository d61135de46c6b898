"""Options that several commands share."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

import click

from skinbus.cli import output
from skinbus.model import Arm
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


def file_option(*names: str, **settings: Any) -> Callable[..., Any]:
    """Return an option that names a file; ``settings`` are those of click."""
    return click.option(*names, type=INPUT, **settings)


_INTERFACE = click.option(
    "--interface", help="python-can interface: socketcan (default), virtual, udp_multicast, slcan, pcan, ..."
)
_CHANNEL = click.option(
    "-c",
    "--channel",
    help="Channel of the interface; by default can0 on socketcan, 239.74.163.2 on udp_multicast.",
)
_CHANNELS = click.option(
    "-c",
    "--channel",
    "channels",
    multiple=True,
    help="Channel of the interface: one for each bus in the order of the arm file, or NAME=CHANNEL. By "
    "default that of the arm file; without one, can0 (239.74.163.2 with udp_multicast) for a single bus.",
)
_BITRATE = click.option(
    "--bitrate",
    type=click.IntRange(10_000, 1_000_000),
    help="Bit/s, if the interface can set it (default: that of the arm file, or 1000000).",
)
_NAME = click.option("--bus", "name", help="Name of the bus, when the arm has several.")


class BusWords(NamedTuple):
    """One bus as the command line names it."""

    interface: str | None
    channel: str | None
    bitrate: int | None
    name: str | None = None

    def place(self) -> BusAddress:
        """Return where the bus is, without an arm file."""
        return addresses.find_place(self.interface, self.channel, self.bitrate)

    def of(self, arm: Arm) -> tuple[Arm, BusAddress]:
        """Return the part of an arm on this bus, and where the bus is."""
        part = addresses.one_bus(arm, self.name)
        channels = (self.channel,) if self.channel else ()
        return part, addresses.find_places(part.buses, self.interface, channels, self.bitrate)[0]


class BusesWords(NamedTuple):
    """The buses of an arm as the command line names them."""

    interface: str | None
    channels: tuple[str, ...]
    bitrate: int | None


def _joined(name: str, kind: Any, *options: Any) -> Callable[..., Any]:
    """Return what adds options of buses to a command and hands them to it as one argument."""

    def add(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def joined(**given: Any) -> Any:
            words = kind(**{key: given.pop(key) for key in kind._fields if key in given})
            return command(**{name: words}, **given)

        added: Callable[..., Any] = joined
        for option in reversed(options):
            added = option(added)
        return added

    return add


bus_options = _joined("bus", BusWords, _INTERFACE, _CHANNEL, _BITRATE)
"""Add --interface, --channel and --bitrate; the command gets them as ``bus: BusWords``."""
arm_bus_options = _joined("bus", BusWords, _INTERFACE, _CHANNEL, _BITRATE, _NAME)
"""Add the same for one bus of an arm, and --bus, which one."""
buses_options = _joined("where", BusesWords, _INTERFACE, _CHANNELS, _BITRATE)
"""Add the same for all buses of an arm; the command gets them as ``where: BusesWords``."""

LEVELS = ("kmeans", "fit", "full")
"""Names of the estimator's levels, without its imports; a test holds both lists equal."""
DEFAULT_LEVEL = "fit"
"""The estimator's own, held equal by the same test."""


def level_option(what: str = "Level of the estimator.") -> Callable[..., Any]:
    """Return --level."""
    choice = click.Choice(LEVELS)
    return click.option("--level", default=DEFAULT_LEVEL, show_default=True, type=choice, help=what)


log_channels_option = click.option(
    "-c",
    "--channel",
    "channels",
    multiple=True,
    help="Interface in the log: one for each bus in the order of the arm file, or NAME=CHANNEL. By default "
    "what the arm file says, or the only one in the log.",
)


seconds_option = click.option(
    "--seconds", type=Range(min=0.0, min_open=True), help="Stop after this time, s."
)


json_option = click.option(
    "--json",
    "json_file",
    type=click.Path(dir_okay=False, allow_dash=True),
    callback=output.json_file,
    help="Write a summary to this file; - writes it, and nothing else, to standard output.",
)
