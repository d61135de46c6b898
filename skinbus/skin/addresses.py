"""Where the buses of an arm are: what the user says, else what the arm file says, else the usual channel."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

from skinbus.bus.interface import Bus
from skinbus.bus.pythoncan import DEFAULT_CHANNELS, DEFAULT_INTERFACE, PythonCanBus, known_interfaces
from skinbus.bus.socketcan import SocketCanBus
from skinbus.bus.socketcan_batch import CANFD_MTU
from skinbus.errors import AddressError
from skinbus.model import Arm, BusSettings

NEED_CHANNEL = ("slcan", "serial", "robotell", "seeedstudio")
"""Interfaces behind a serial port; python-can has no default for it."""


ALWAYS_FD = ("udp_multicast", "virtual")
"""Interfaces on which a CAN FD socket receives classic frames too."""


class BusAddress(NamedTuple):
    """An interface by the words with which python-can opens it."""

    interface: str
    channel: str | None
    bitrate: int
    data_bitrate: int | None = None
    """Of CAN FD; None for classic CAN."""
    name: str = ""
    """Of the bus in the arm file."""

    def open(self) -> Bus:
        """Open it; BusError says what to do if that fails."""
        fd = self.data_bitrate is not None
        if self.interface == DEFAULT_INTERFACE:  # read in batches; all others through python-can
            return SocketCanBus(self.channel or DEFAULT_CHANNELS[DEFAULT_INTERFACE], fd=fd)
        return PythonCanBus(self.interface, self.channel, bitrate=self.bitrate, fd=fd)

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}" if self.channel else self.interface


def to_listen(place: BusAddress) -> BusAddress:
    """Return a place that is opened for all that may come there, long frames too where it carries them."""
    return place._replace(data_bitrate=place.data_bitrate or place.bitrate) if carries_fd(place) else place


def carries_fd(place: BusAddress) -> bool:
    """Whether frames of CAN FD may come: as the arm file says, or as the interface is."""
    if place.data_bitrate is not None or place.interface in ALWAYS_FD:
        return True
    mtu = Path(f"/sys/class/net/{place.channel}/mtu")
    try:
        return place.interface == "socketcan" and int(mtu.read_text()) >= CANFD_MTU
    except OSError:  # it is not there: opening it says so
        return False


def find_places(
    buses: Sequence[BusSettings], interface: str | None, channels: Sequence[str], bitrate: int | None
) -> list[BusAddress]:
    """Return the place of each bus; ``channels`` are CHANNEL in the order of the buses, or NAME=CHANNEL.

    Raises:
        AddressError: they do not fit the buses; the message names these.
    """
    faults: list[str] = []
    places: list[BusAddress] = []
    for bus, said in zip(buses, channels_by_name(buses, channels), strict=True):
        where = interface_of(bus, interface)
        channel = said or bus.channel or (DEFAULT_CHANNELS.get(where) if len(buses) == 1 else None)
        if channel is None and len(buses) > 1:
            faults.append(f"bus {bus.name} has no channel: {how_to_say(bus)}, or channel in its [[bus]]")
        elif channel is None and where in NEED_CHANNEL:
            faults.append(f"{where} is behind a serial port: give --channel, such as /dev/ttyACM0")
        place = BusAddress(where, channel, bitrate or bus.bitrate, bus.data_bitrate, bus.name)
        if channel is not None and place[:2] in [other[:2] for other in places]:
            faults.append(f"bus {bus.name} is on {place}, as another bus is")
        places.append(place)
    if faults:
        raise AddressError("; ".join(faults))
    return places


def how_to_say(bus: BusSettings) -> str:
    """Return how the channel of one of several buses is said."""
    return f'--channel {bus.name}=... (channel={{"{bus.name}": ...}} in Python)'


def interface_of(bus: BusSettings, interface: str | None) -> str:
    """Return the interface of a bus: as given, else as in its file, else the usual one.

    Raises:
        AddressError: there is no such interface.
    """
    where = interface or bus.interface or DEFAULT_INTERFACE
    if where not in known_interfaces():
        near = get_close_matches(where, known_interfaces(), n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise AddressError(f"unknown interface {where!r}; {hint}known: {', '.join(known_interfaces())}")
    return where


def channels_by_name(buses: Sequence[BusSettings], channels: Sequence[str]) -> list[str | None]:
    """Return the channel said for each bus, None where none was."""
    names = [bus.name for bus in buses]
    known = (
        f"the buses are {', '.join(names)}"
        if len(names) > 1 or names[0]
        else "there is one bus, without a name"
    )
    if len(channels) > len(buses):
        raise AddressError(f"{len(channels)} channels; {known}")
    pairs = [channel.partition("=") for channel in channels]
    named = [bool(sign) and (len(buses) > 1 or name in names) for name, sign, _ in pairs]
    said = {name: channel for name, _, channel in pairs}
    # an = may be part of a channel: that of a path, say
    strangers = [name for name, sign, _ in pairs if sign and name.isidentifier() and name not in names]
    if strangers:
        raise AddressError(f"no bus is called {strangers[0]}; {known}")
    if not any(named):
        return [*channels, *[None] * (len(buses) - len(channels))]
    if not all(named):
        raise AddressError(f"either every --channel is NAME=CHANNEL or none; {known}")
    if len(said) < len(pairs):
        raise AddressError(f"a bus is named twice; {known}")
    return [said.get(name) for name in names]


def bus_numbers(arm: Arm, names: Sequence[str]) -> list[int]:
    """Return the numbers of named buses, of all when none is named; UsageError says which there are."""
    known = [bus.name for bus in arm.buses]
    for name in names:
        if name not in known:
            there = f"there are: {', '.join(known)}" if known[0] else "it has one, without a name"
            raise AddressError(f"no bus of {arm.name} is called {name}; {there}")
    return [k for k, name in enumerate(known) if not names or name in names]


def one_bus(arm: Arm, names: Sequence[str]) -> Arm:
    """Return the arm as far as it is on one bus, for commands that work on one at a time."""
    numbers = bus_numbers(arm, names)
    if len(numbers) > 1:
        known = ", ".join(bus.name for bus in arm.buses)
        raise AddressError(f"{arm.name} has several buses; say which by --bus: {known}")
    return arm.part(numbers[0])


def shown(places: Sequence[BusAddress]) -> str:
    """Return places as text."""
    return ", ".join(map(str, places))
