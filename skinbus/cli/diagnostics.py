"""Checks of a machine that is to run a master: what was found, and what to do if that is wrong."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from skinbus.bus.monotonic_clock import sharpen_timers
from skinbus.bus.socketcan_batch import CANFD_MTU
from skinbus.errors import BusError
from skinbus.skin.addresses import BusAddress

NET: Final = Path("/sys/class/net")
IFF_UP: Final = 1
ARPHRD_CAN: Final = "280"
MIN_QUEUE: Final = 64
"""Frames the send queue should hold: a cycle's 17 contact frames, and SDO to many patches at once."""

LATE_US: Final = 500
"""A wake-up that is later than this is a twentieth of a cycle at 100 Hz."""

N_SLEEPS: Final = 300


class Finding(NamedTuple):
    """One check's outcome; ``advice`` is empty when all is well."""

    check: str
    found: str
    advice: str = ""


def check_interface(place: BusAddress) -> Iterator[Finding]:
    """Is a SocketCAN interface there, up, healthy, at the arm's bit rates; does its queue hold a cycle?"""
    channel, folder = str(place.channel), NET / str(place.channel)
    known = sorted(path.parent.name for path in NET.glob("*/type") if path.read_text().strip() == ARPHRD_CAN)
    if channel not in known:
        there = f"CAN interfaces here: {', '.join(known)}" if known else "load the adapter's driver"
        other = "; without CAN in the kernel, try --interface udp_multicast"
        yield Finding("interface", f"{channel} does not exist or is no CAN interface", there + other)
        return
    link = _link(channel)
    settings = "" if link.get("info_kind") in ("vcan", "vxcan") else f" {_settings(place)}"
    up = f"ip link set {channel} up{settings}"
    flags, mtu, queue = (int((folder / name).read_text(), 0) for name in ("flags", "mtu", "tx_queue_len"))
    yield _found("interface", f"{channel} is {'up' if flags & IFF_UP else 'down'}", not flags & IFF_UP, up)
    if link.get("info_kind") == "can":
        yield from check_controller(place, link.get("info_data", {}))
    if place.data_bitrate:
        how = f"ip link set {channel} down; ip link set {channel} mtu {CANFD_MTU}; {up}"
        yield _found("CAN FD", f"mtu {mtu}", mtu < CANFD_MTU, how)
    longer = f"ip link set {channel} txqueuelen 128"
    yield _found("send queue", f"{queue} frames" if queue else "unlimited", 0 < queue < MIN_QUEUE, longer)


def check_controller(place: BusAddress, data: dict[str, Any]) -> Iterator[Finding]:
    """Check bit rates, state and restart of a real controller."""
    again = f"ip link set {place.channel} down; ip link set {place.channel} up {_settings(place)}"
    for kind, key, wanted in (
        ("bit rate", "bittiming", place.bitrate),
        ("data bit rate", "data_bittiming", place.data_bitrate),
    ):
        # ip(8) has two places for it: controllers with a table of bit rates, as slcan, are in the second.
        actual = data.get(key, {}).get("bitrate") or data.get(f"{key}_bitrate")
        if wanted:
            yield _found(kind, f"{actual or 'unknown'} bit/s", bool(actual) and actual != wanted, again)
    state, restart = data.get("state", "unknown"), data.get("restart_ms", 0)
    wiring = "check wiring, both 120 ohm terminators, and the bit rate of all nodes"
    yield _found("controller", state, state in ("BUS-OFF", "ERROR-PASSIVE"), wiring)
    yield _found("bus-off", f"restarts after {restart} ms" if restart else "stays off", not restart, again)


def _found(check: str, found: str, is_wrong: bool, advice: str) -> Finding:
    return Finding(check, found, advice if is_wrong else "")


def check_open(place: BusAddress) -> Iterator[Finding]:
    """May this user open the interface?"""
    try:
        place.open().close()
    except BusError as error:
        yield Finding("permission", str(error), "see the message")
        return
    yield Finding("permission", f"{place} can be opened")


def check_machine() -> Iterator[Finding]:
    """May this user have real-time priority, and does a sleep end in time?"""
    is_allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[0] != 0 or os.geteuid() == 0
    service = "run it as the service that `skinbus doctor --unit` prints"
    found = "allowed" if is_allowed else "not allowed for this user"
    yield _found("real-time priority", found, not is_allowed, service)
    sharpen_timers()
    late_us = []
    for _ in range(N_SLEEPS):
        wake_ns = time.monotonic_ns() + 1_000_000
        time.sleep(0.001)
        late_us.append((time.monotonic_ns() - wake_ns) / 1e3)
    p99 = np.percentile(late_us, 99)
    how = f"{service}, end other work, set the CPU to `performance` (cpupower), or take a PREEMPT_RT kernel"
    yield _found("wake-ups", f"late by {p99:.0f} us (p99)", bool(p99 >= LATE_US), how)


def _settings(place: BusAddress) -> str:
    """The arguments of ip(8) for a controller."""
    fd = f" dbitrate {place.data_bitrate} fd on" if place.data_bitrate else ""
    return f"type can bitrate {place.bitrate}{fd} restart-ms 100"


def _link(channel: str) -> dict[str, Any]:
    """What ip(8) reports of the interface; nothing without it."""
    try:
        answer = subprocess.run(
            ["ip", "-details", "-json", "link", "show", channel], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return {}
    return dict(json.loads(answer.stdout)[0].get("linkinfo", {}))
