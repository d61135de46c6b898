"""Notifications of a service to systemd: ready, alive, stopping (sd_notify, 3)."""

from __future__ import annotations

import os
import socket
import time
from contextlib import suppress


class Notifier:
    """Reports to systemd; without one, or outside a unit with ``Type=notify``, it does nothing."""

    def __init__(self) -> None:
        path = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path.startswith("@") else path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if path else None
        # A quarter of the time of systemd's watchdog: of two that are due one may come late.
        self._period_ns = int(os.environ.get("WATCHDOG_USEC", "0") or 0) * 250
        self._next_ns: int | None = None
        """When a sign of life is due; None before the first."""

    def alive(self, status: str) -> None:
        """A cycle has ended: the first one means ready, later ones are signs of life."""
        now_ns = time.monotonic_ns()
        if self._next_ns is None:
            self._next_ns = now_ns
            self._send(f"READY=1\nSTATUS={status}")
        if self._period_ns and now_ns >= self._next_ns:
            self._next_ns = now_ns + self._period_ns
            self._send(f"WATCHDOG=1\nSTATUS={status}")

    def stopping(self) -> None:
        """The end was asked for."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Let go of the socket."""
        if self._socket:
            self._socket.close()

    def _send(self, text: str) -> None:
        if self._socket:
            with suppress(OSError):  # a manager that does not listen must not stop the arm
                self._socket.sendto(text.encode(), socket.MSG_DONTWAIT, self._address)
