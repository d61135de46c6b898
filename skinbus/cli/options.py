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
    return click.option(*names, type=click.Path(dir_okay=False, path_type=Path), **settings)


def _bitrate_option(default: str) -> Any:
    return click.option(
        "--bitrate",
        default=None,
        type=click.IntRange(10_000, 1_000_000),
        help=f"Bit/s, where the interface lets it be set (default: {default}).",
    )


interface_option = click.option(
    "--interface",
    default=None,
    help="python-can interface: socketcan (default), virtual, udp_multicast, slcan, pcan, ...",
)
channel_option = click.option(
    "-c",
    "--channel",
    default=None,
    help="Channel of the interface; by default can0 on socketcan, 239.74.163.2 on udp_multicast.",
)
bus_option = click.option(
    "--bus", "bus_name", default=None, help="Name of the bus, when the arm has several."
)


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


def _one_bus(command: Callable[..., Any]) -> Callable[..., Any]:
    """Join the words for a bus to the argument ``bus`` of a command."""

    @wraps(command)
    def joined(
        interface: str | None,
        channel: str | None,
        bitrate: int | None,
        bus_name: str | None = None,
        **others: Any,
    ) -> Any:
        return command(bus=BusWords(interface, channel, bitrate, bus_name), **others)

    return joined


def bus_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --interface, --channel and --bitrate; the command gets them as ``bus: BusWords``."""
    options: Callable[..., Any] = interface_option(
        channel_option(_bitrate_option("1000000")(_one_bus(command)))
    )
    return options


def arm_bus_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the same for one bus of an arm, and --bus, which one."""
    bitrate = _bitrate_option("what the arm file says")
    options: Callable[..., Any] = interface_option(channel_option(bitrate(bus_option(_one_bus(command)))))
    return options


class BusesWords(NamedTuple):
    """The buses of an arm as the command line names them."""

    interface: str | None
    channels: tuple[str, ...]
    bitrate: int | None


def buses_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the same for all buses of an arm; the command gets them as ``where: BusesWords``."""

    @wraps(command)
    def joined(interface: str | None, channels: tuple[str, ...], bitrate: int | None, **others: Any) -> Any:
        return command(where=BusesWords(interface, channels, bitrate), **others)

    channels = click.option(
        "-c",
        "--channel",
        "channels",
        multiple=True,
        help="Channel of the interface: one for each bus in the order of the arm file, or NAME=CHANNEL. By "
        "default what the arm file says; a single bus is else on can0, or 239.74.163.2 with udp_multicast.",
    )
    options: Callable[..., Any] = interface_option(
        channels(_bitrate_option("what the arm file says")(joined))
    )
    return options


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
    "--seconds", type=Range(min=0.0, min_open=True), help="Stop by itself after this time."
)


json_option = click.option(
    "--json",
    "json_file",
    type=click.Path(dir_okay=False, allow_dash=True),
    callback=output.json_file,
    help="Write a summary to this file; - is standard output, with nothing else on it.",
)
