"""Requests of clients for NMT commands (0x1F82, CiA 302-2): to one patch, to all, or to the own node."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from skinbus.master.patches.expected_nodes import ExpectedNode
from skinbus.master.patches.passive_monitor import PatchMonitor
from skinbus.master.patches.supervisor import RESETS
from skinbus.node.device import Device
from skinbus.objects.cia import REQUEST_NMT, REQUEST_NMT_ALL, AbortCode, NmtCommand

COMMANDS: Final = {
    0x04: NmtCommand.STOP,
    0x05: NmtCommand.START,
    0x06: NmtCommand.RESET_NODE,
    0x07: NmtCommand.RESET_COMMUNICATION,
    0x7F: NmtCommand.PRE_OPERATIONAL,
}
"""Values of 0x1F82 as they are written."""
WITHOUT_MASTER: Final = {
    0x84: NmtCommand.STOP,
    0x85: NmtCommand.START,
    0x86: NmtCommand.RESET_NODE,
    0x87: NmtCommand.RESET_COMMUNICATION,
    0x8F: NmtCommand.PRE_OPERATIONAL,
}
"""The same, but the own node is left out of "all"."""


class Requests:
    """Passes what a client writes to 0x1F82 on to those who do it; nothing is done before it is answered."""

    def __init__(self, device: Device, plans: Sequence[ExpectedNode], watch: PatchMonitor) -> None:
        self._device = device
        self._watch = watch
        self._patches = {plan.node_id: p for p, plan in enumerate(plans)}
        self._own: NmtCommand | None = None

    def obey(self, index: int, sub: int, value: int) -> AbortCode | None:
        """Take a write from the bus; return why it is refused, None for other objects too."""
        if index != REQUEST_NMT:
            return None
        command = COMMANDS.get(value) or WITHOUT_MASTER.get(value)
        if command is None:
            return AbortCode.VALUE_INVALID
        if sub == REQUEST_NMT_ALL:
            refused = self._watch.request(None, command)
            if refused is None and command in RESETS and value in COMMANDS:
                self._own = command
            return refused
        if sub == self._device.node_id:
            # An NMT master is operational: nobody else would start the patches again.
            if command not in (*RESETS, NmtCommand.START):
                return AbortCode.DEVICE_STATE
            self._own = command
            return None
        p = self._patches.get(sub)
        return AbortCode.LOCAL_CONTROL if p is None else self._watch.request(p, command)

    def command_own(self) -> None:
        """Command the own node, if that was asked for."""
        command, self._own = self._own, None
        if command is not None:
            self._device.command(command)
