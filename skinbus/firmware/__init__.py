"""Firmware of a board as a C99 project: the core and the ports as they are, and tables made from its EDS."""

from skinbus.firmware.project import write_project, write_relay

__all__ = ["write_project", "write_relay"]
