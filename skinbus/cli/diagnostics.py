"""Checks of a machine that is to run a master: what was found, and what to do if that is wrong."""

from __future__ import annotations

import ctypes
import json
import os
import resource
import socket
import subprocess
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from skinbus.bus.monotonic_clock import sharpen_timers
from skinbus.bus.socketcan import RECEIVE_BUFFER
from skinbus.bus.socketcan_batch import CANFD_MTU
from skinbus.cli.formatting import counted
from skinbus.errors import BusError
from skinbus.jit.kernel_files import kernel_folder, verify_entries
from skinbus.model import Arm
from skinbus.skin.addresses import BusAddress

NET: Final = Path("/sys/class/net")
IFF_UP: Final = 1
ARPHRD_CAN: Final = "280"
MIN_QUEUE: Final = 64
"""Frames the send queue should hold: a cycle's 17 contact frames, and SDO to many patches at once."""

LATE_US: Final = 500
"""A wake-up that is later than this is a twentieth of a cycle at 100 Hz."""

N_SLEEPS: Final = 300
CAP_SYS_NICE: Final = 23


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One check's outcome; ``advice`` is empty when all is well."""

    check: str
    found: str
    advice: str = ""

    def as_row(self) -> dict[str, Any]:
        """For a program."""
        return {**asdict(self), "ok": not self.advice}


def _without_interfaces() -> str:
    """Return what to do where there is no CAN interface at all."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return "a kernel with CAN; without one, try --interface udp_multicast"
    return "load the adapter's driver"


def check_interface(place: BusAddress) -> Iterator[Finding]:
    """Is a SocketCAN interface there, up, healthy, at the arm's bit rates; does its queue hold a cycle?"""
    channel = str(place.channel)
    folder = NET / channel
    interfaces = _can_interfaces()
    if channel not in interfaces:
        known = f"CAN interfaces here: {', '.join(interfaces)}" if interfaces else _without_interfaces()
        what = "is no CAN interface" if folder.exists() else "does not exist"
        yield Finding(check="interface", found=f"{channel} {what}", advice=known)
        return
    link = _link(channel)
    is_virtual = link.get("info_kind") in ("vcan", "vxcan")
    if int((folder / "flags").read_text(), 16) & IFF_UP:
        yield Finding(check="interface", found=f"{channel} is up")
    else:
        how = f"ip link set {channel} up" + ("" if is_virtual else f" {_settings(place)}")
        yield Finding(check="interface", found=f"{channel} is down", advice=how)
    if link.get("info_kind") == "can":
        yield from check_controller(place, link.get("info_data", {}))
    elif link:
        yield Finding(check="bit rate", found=f"{link.get('info_kind', 'unknown')} has none")
    if place.data_bitrate:
        mtu = int((folder / "mtu").read_text())
        down = f"ip link set {channel} down; ip link set {channel}"
        how = f"{down} mtu {CANFD_MTU} up" if is_virtual else f"{down} up {_settings(place)}"
        found = "yes" if mtu >= CANFD_MTU else f"no (mtu {mtu})"
        yield Finding(check="CAN FD", found=found, advice="" if mtu >= CANFD_MTU else how)
    queue = int((folder / "tx_queue_len").read_text())
    advice = f"ip link set {channel} txqueuelen 128" if 0 < queue < MIN_QUEUE else ""
    yield Finding(check="send queue", found=f"{queue} frames" if queue else "unlimited", advice=advice)


def check_open(place: BusAddress) -> Iterator[Finding]:
    """May this user open the interface, and how much does the kernel hold for it?"""
    try:
        place.open().close()
    except BusError as error:
        yield Finding(check="permission", found=str(error), advice="see the message")
        return
    yield Finding(check="permission", found=f"{place} can be opened")
    limit_file = Path("/proc/sys/net/core/rmem_max")
    if place.interface == "socketcan" and limit_file.exists():
        limit = int(limit_file.read_text())
        advice = f"sysctl -w net.core.rmem_max={RECEIVE_BUFFER}" if limit < RECEIVE_BUFFER // 8 else ""
        yield Finding(check="receive buffer", found=f"up to {limit >> 10} kB", advice=advice)


def check_priority() -> Iterator[Finding]:
    """May this user have real-time priority and locked memory?"""
    allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[0] != 0 or _has_capability(CAP_SYS_NICE)
    advice = "" if allowed else "run it as the service that `skinbus doctor --unit` prints"
    found = "allowed" if allowed else "not allowed for this user"
    yield Finding(check="real-time priority", found=found, advice=advice)
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    enough = limit == resource.RLIM_INFINITY or limit >= 1 << 30 or os.geteuid() == 0
    advice = "" if enough else "the service sets LimitMEMLOCK=infinity; or raise `ulimit -l`"
    yield Finding(check="memory lock", found="allowed" if enough else f"{limit >> 10} kB", advice=advice)


def check_clock() -> Iterator[Finding]:
    """Does the clock tick finely, and does a sleep end in time?"""
    source = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    name = source.read_text().strip() if source.exists() else "unknown"
    advice = (
        f"{name} is slow to read; look in dmesg why tsc was given up" if name in ("hpet", "acpi_pm") else ""
    )
    yield Finding(check="clock", found=name, advice=advice)
    sharpen_timers()
    late_us = np.zeros(N_SLEEPS)
    for i in range(N_SLEEPS):
        wake_ns = time.monotonic_ns() + 1_000_000
        time.sleep(0.001)
        late_us[i] = (time.monotonic_ns() - wake_ns) / 1e3
    p50, p99 = np.percentile(late_us, [50, 99])
    late = "run the service (SCHED_FIFO), end other work, or take a PREEMPT_RT kernel"
    advice = late if p99 >= LATE_US else ""
    yield Finding(check="wake-ups", found=f"late by {p50:.0f} us, p99 {p99:.0f} us", advice=advice)
    governors = {path.read_text().strip() for path in Path("/sys/devices/system/cpu").glob(_GOVERNOR)}
    if governors:
        advice = "cpupower frequency-set -g performance" if "powersave" in governors else ""
        yield Finding(check="CPU frequency", found=", ".join(sorted(governors)), advice=advice)


def check_cache() -> Iterator[Finding]:
    """Are compiled kernels kept on disk, so that only the first start is slow, and can all be loaded?"""
    folder = kernel_folder()
    if folder.path is None:
        advice = "set NUMBA_CACHE_DIR to a folder of this user; until then every start compiles the kernels"
        yield Finding(check="kernel cache", found=f"none: {folder.fault}", advice=advice)
        return
    sound, damaged = verify_entries()
    found = counted(sound, "kernel") + (f", {damaged} damaged ones removed" if damaged else "")
    advice = "" if sound and not damaged else "skinbus doctor warm  (compiles them once)"
    yield Finding(check="kernel cache", found=f"{found} in {folder.path}", advice=advice)


def check_arm(arm: Arm) -> Iterator[Finding]:
    """How many patches has the arm, and how fast are its buses? One that is overloaded was refused."""
    speeds = " and ".join(f"{bus.bitrate // 1000} kbit/s" for bus in arm.buses)
    found = f"{counted(arm.n_patches, 'patch')} at {arm.bus.rate_hz:g} Hz, {speeds}"
    yield Finding(check="arm", found=f"{arm.name}: {found}")


_GOVERNOR: Final = "cpu[0-9]*/cpufreq/scaling_governor"


def check_controller(place: BusAddress, data: dict[str, Any]) -> Iterator[Finding]:
    """Check bit rates, state and restart of a real controller."""
    again = f"ip link set {place.channel} down; ip link set {place.channel} up {_settings(place)}"
    timings = [("bit rate", "bittiming", place.bitrate)]
    if place.data_bitrate:
        timings.append(("data bit rate", "data_bittiming", place.data_bitrate))
    for check, key, wanted in timings:
        # ip(8) has two places for it: controllers with a table of bit rates, as slcan, are in the second.
        actual = data.get(key, {}).get("bitrate") or data.get(f"{key}_bitrate")
        advice = again if actual and actual != wanted else ""
        yield Finding(check=check, found=f"{actual or 'unknown'} bit/s", advice=advice)
    state = data.get("state", "unknown")
    bad = state in ("BUS-OFF", "ERROR-PASSIVE")
    advice = "check wiring, both 120 ohm terminators, and the bit rate of all nodes" if bad else ""
    yield Finding(check="controller", found=state, advice=advice)
    restart = int(data.get("restart_ms", 0) or 0)
    yield Finding(
        check="bus-off",
        found=f"restarts after {restart} ms" if restart else "stays off",
        advice="" if restart else again,
    )


def _settings(place: BusAddress) -> str:
    """The arguments of ip(8) for a controller."""
    fd = f" dbitrate {place.data_bitrate} fd on" if place.data_bitrate else ""
    return f"type can bitrate {place.bitrate}{fd} restart-ms 100"


def _can_interfaces() -> list[str]:
    types = ((path.parent.name, path.read_text().strip()) for path in NET.glob("*/type"))
    return sorted(name for name, kind in types if kind == ARPHRD_CAN)


def _link(channel: str) -> dict[str, Any]:
    """What ip(8) reports of the interface; nothing without it."""
    try:
        answer = subprocess.run(
            ["ip", "-details", "-json", "link", "show", channel], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return {}
    return dict(json.loads(answer.stdout)[0].get("linkinfo", {}))


def _has_capability(number: int) -> bool:
    header, data = (ctypes.c_uint32 * 2)(0x2008_0522, 0), (ctypes.c_uint32 * 6)()
    if ctypes.CDLL(None).capget(header, data):
        return False
    return bool(data[number // 32 * 3] >> number % 32 & 1)
