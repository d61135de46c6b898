"""What the master expects of a patch, by its EDS and the arm file: identity, configuration, heartbeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from canopen.objectdictionary import ObjectDictionary

from skinbus.model import Arm
from skinbus.node.sdo_server import HEAD
from skinbus.objects import cia
from skinbus.objects.dcf import Configuration, configuration, is_verified
from skinbus.objects.profile import number_at

DOWNLOADS: Final = (1, 6)
"""Client command specifiers that begin a download, in segments and in blocks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Identity of a patch; zero means that any value will do (CiA 302-2, 0x1F84-0x1F88)."""

    device_type: int = 0
    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedNode:
    """What the master expects of a patch; ``heartbeat_ns`` is the period of its heartbeat, 0 for none."""

    node_id: int
    identity: Identity
    configuration: Configuration
    heartbeat_ns: int = 0


def expected_nodes(arm: Arm, ods: Sequence[ObjectDictionary]) -> list[ExpectedNode]:
    """Return what the master expects of the patches of an arm, by their dictionaries."""
    window_us = round(1e6 / arm.bus.rate_hz)
    return [
        expected_node(node_id, od, window_us=window_us)
        for node_id, od in zip(arm.node_id.tolist(), ods, strict=True)
    ]


def expected_node(node_id: int, od: ObjectDictionary, *, window_us: int = 0) -> ExpectedNode:
    """Return what the EDS of a patch asks for; an identity left out or zero is not checked.

    ``window_us`` is the period of the SYNC: TPDOs of a patch that are later than that it is not to send.
    """
    return ExpectedNode(
        node_id=node_id,
        identity=Identity(
            device_type=number_at(od, cia.DEVICE_TYPE),
            vendor=number_at(od, cia.IDENTITY, cia.IDENTITY_VENDOR),
            product=number_at(od, cia.IDENTITY, cia.IDENTITY_PRODUCT),
            revision=number_at(od, cia.IDENTITY, cia.IDENTITY_REVISION),
            serial=number_at(od, cia.IDENTITY, cia.IDENTITY_SERIAL),
        ),
        configuration=configuration(od, window_us=window_us),
        heartbeat_ns=number_at(od, cia.HEARTBEAT_PRODUCER) * 1_000_000,
    )


def foreign_write(request: bytes) -> str:
    """Return what an SDO request (8 bytes) writes, if the pipeline depends on that object, else nothing."""
    if len(request) < HEAD.size or request[0] >> 5 not in DOWNLOADS:
        return ""
    _, index, sub = HEAD.unpack_from(request)
    return f"0x{index:04X}:{sub:02X}" if is_verified(index) else ""
