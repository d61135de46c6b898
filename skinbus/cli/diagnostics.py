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
from skinbus.cli.formatting import counted
from skinbus.errors import BusError
from skinbus.jit.kernel_files import kernel_folder, verify_entries
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

    def as_row(self) -> dict[str, Any]:
        """For a program."""
        return {**self._asdict(), "ok": not self.advice}


def check_interface(place: BusAddress) -> Iterator[Finding]:
    """Is a SocketCAN interface there, up, healthy, at the arm's bit rates; does its queue hold a cycle?"""
    channel = str(place.channel)
    folder = NET / channel
    known = sorted(path.parent.name for path in NET.glob("*/type") if path.read_text().strip() == ARPHRD_CAN)
    if channel not in known:
        there = f"CAN interfaces here: {', '.join(known)}" if known else "load the adapter's driver"
        other = "; without CAN in the kernel, try --interface udp_multicast"
        yield Finding("interface", f"{channel} does not exist or is no CAN interface", there + other)
        return
    link = _link(channel)
    is_virtual = link.get("info_kind") in ("vcan", "vxcan")
    up = f"ip link set {channel} up" + ("" if is_virtual else f" {_settings(place)}")
    is_up = int((folder / "flags").read_text(), 16) & IFF_UP
    yield Finding("interface", f"{channel} is {'up' if is_up else 'down'}", "" if is_up else up)
    if link.get("info_kind") == "can":
        yield from check_controller(place, link.get("info_data", {}))
    if place.data_bitrate:
        mtu = int((folder / "mtu").read_text())
        how = f"ip link set {channel} down; ip link set {channel} mtu {CANFD_MTU}; {up}"
        found = "yes" if mtu >= CANFD_MTU else f"no (mtu {mtu})"
        yield Finding("CAN FD", found, "" if mtu >= CANFD_MTU else how)
    queue = int((folder / "tx_queue_len").read_text())
    advice = f"ip link set {channel} txqueuelen 128" if 0 < queue < MIN_QUEUE else ""
    yield Finding("send queue", f"{queue} frames" if queue else "unlimited", advice)


def check_controller(place: BusAddress, data: dict[str, Any]) -> Iterator[Finding]:
    """Check bit rates, state and restart of a real controller."""
    again = f"ip link set {place.channel} down; ip link set {place.channel} up {_settings(place)}"
    for check, key, wanted in (
        ("bit rate", "bittiming", place.bitrate),
        ("data bit rate", "data_bittiming", place.data_bitrate),
    ):
        # ip(8) has two places for it: controllers with a table of bit rates, as slcan, are in the second.
        actual = data.get(key, {}).get("bitrate") or data.get(f"{key}_bitrate")
        if wanted:
            advice = again if actual and actual != wanted else ""
            yield Finding(check, f"{actual or 'unknown'} bit/s", advice)
    state = data.get("state", "unknown")
    wiring = "check wiring, both 120 ohm terminators, and the bit rate of all nodes"
    yield Finding("controller", state, wiring if state in ("BUS-OFF", "ERROR-PASSIVE") else "")
    restart = int(data.get("restart_ms", 0) or 0)
    found = f"restarts after {restart} ms" if restart else "stays off"
    yield Finding("bus-off", found, "" if restart else again)


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
    allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[0] != 0 or os.geteuid() == 0
    service = "run it as the service that `skinbus doctor --unit` prints"
    found = "allowed" if allowed else "not allowed for this user"
    yield Finding("real-time priority", found, "" if allowed else service)
    sharpen_timers()
    late_us = np.zeros(N_SLEEPS)
    for i in range(N_SLEEPS):
        wake_ns = time.monotonic_ns() + 1_000_000
        time.sleep(0.001)
        late_us[i] = (time.monotonic_ns() - wake_ns) / 1e3
    p50, p99 = np.percentile(late_us, [50, 99])
    late = f"{service}, end other work, set the CPU to `performance` (cpupower), or take a PREEMPT_RT kernel"
    yield Finding("wake-ups", f"late by {p50:.0f} us, p99 {p99:.0f} us", late if p99 >= LATE_US else "")


def check_cache() -> Iterator[Finding]:
    """Are compiled kernels kept on disk, so that only the first start is slow, and can all be loaded?"""
    folder = kernel_folder()
    if folder.path is None:
        advice = "set NUMBA_CACHE_DIR to a folder of this user; until then every start compiles the kernels"
        yield Finding("kernel cache", f"none: {folder.fault}", advice)
        return
    sound, damaged = verify_entries()
    found = counted(sound, "kernel") + (f", {damaged} damaged ones removed" if damaged else "")
    advice = "" if sound and not damaged else "skinbus doctor warm  (compiles them once)"
    yield Finding("kernel cache", f"{found} in {folder.path}", advice)


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
