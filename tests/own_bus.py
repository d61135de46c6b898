"""Places of a bus on UDP multicast that no other test run on this machine uses."""

import os


def own_group():
    """A multicast group of this process; 239.74.163.x and 239.74.164.x are those of docs and tools."""
    pid = os.getpid()
    return f"239.76.{pid >> 8 & 0xFF}.{pid & 0xFF}"


def own_port():
    """A port of this process, below those that a system gives to sockets without one."""
    return 20_000 + os.getpid() % 10_000
