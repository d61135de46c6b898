"""Opens an interface by its name: SocketCAN read in batches, all others through python-can."""

from __future__ import annotations

from skinbus.bus.interface import Bus
from skinbus.bus.pythoncan import DEFAULT_CHANNELS, PythonCanBus
from skinbus.bus.socketcan import SocketCanBus


def open_interface(
    interface: str,
    channel: str | None = None,
    *,
    bitrate: int | None = None,
    fd: bool = False,
) -> Bus:
    """Open an interface by its python-can name; the arguments are those of its class.

    Raises:
        BusError: it cannot be opened; the message says what to do.
    """
    if interface == "socketcan":
        return SocketCanBus(channel or DEFAULT_CHANNELS["socketcan"], fd=fd)
    return PythonCanBus(interface, channel, bitrate=bitrate, fd=fd)
