"""The NMT state machine as tables: which command leads where, and which services each state has."""

from __future__ import annotations

from enum import Enum, auto

from skinbus.can.frame import Frame
from skinbus.objects.cia import NMT_COMMAND_ID, NmtCommand, NmtState


class Service(Enum):
    """Communication services that a state allows or forbids."""

    NMT = auto()
    ERROR_CONTROL = auto()  # heartbeat, produced and consumed
    SDO = auto()
    SYNC = auto()
    EMCY = auto()
    PDO = auto()
    LSS = auto()


# CiA 301, 7.3.2.2.5. LSS is kept out of OPERATIONAL: nobody renames a node that moves an arm.
_SERVICES = frozenset({Service.NMT, Service.ERROR_CONTROL, Service.SDO, Service.SYNC, Service.EMCY})
SERVICES: dict[NmtState, frozenset[Service]] = {
    NmtState.INITIALISING: frozenset({Service.LSS}),
    NmtState.PRE_OPERATIONAL: _SERVICES | {Service.LSS},
    NmtState.OPERATIONAL: _SERVICES | {Service.PDO},
    NmtState.STOPPED: frozenset({Service.NMT, Service.ERROR_CONTROL, Service.LSS}),
}

# CiA 301, 7.3.2.2, figure 48: from every state of a running node the five commands lead to one state each;
# the two resets pass through INITIALISING and end by themselves in PRE-OPERATIONAL with a boot-up message.
TRANSITIONS: dict[NmtCommand, NmtState] = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
    NmtCommand.RESET_NODE: NmtState.INITIALISING,
    NmtCommand.RESET_COMMUNICATION: NmtState.INITIALISING,
}

COMMAND_LENGTH = 2


def command_for(data: bytes, node_id: int) -> NmtCommand | None:
    """The command a frame holds for this node; None when it is for another node, malformed or unknown."""
    if len(data) != COMMAND_LENGTH or data[1] not in (0, node_id):
        return None
    return _COMMANDS.get(data[0])


_COMMANDS = {int(command): command for command in NmtCommand}


def nmt_frame(command: NmtCommand, node_id: int) -> Frame:
    """Return the frame by which a master commands a node, all of them with node-ID 0."""
    return Frame(NMT_COMMAND_ID, bytes([command, node_id]))
