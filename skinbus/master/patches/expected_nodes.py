"""What the master expects of a patch, by its EDS and the arm file: identity, configuration, heartbeat."""

from __future__ import annotations

from dataclasses import dataclass

from canopen.objectdictionary import ObjectDictionary

from skinbus.objects import cia
from skinbus.objects.dcf import Configuration, configuration
from skinbus.objects.profile import number_at


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


def expected_node(node_id: int, od: ObjectDictionary) -> ExpectedNode:
    """Return what the EDS of a patch asks for; an identity left out or zero is not checked."""
    return ExpectedNode(
        node_id=node_id,
        identity=Identity(
            device_type=number_at(od, cia.DEVICE_TYPE),
            vendor=number_at(od, cia.IDENTITY, cia.IDENTITY_VENDOR),
            product=number_at(od, cia.IDENTITY, cia.IDENTITY_PRODUCT),
            revision=number_at(od, cia.IDENTITY, cia.IDENTITY_REVISION),
            serial=number_at(od, cia.IDENTITY, cia.IDENTITY_SERIAL),
        ),
        configuration=configuration(od),
        heartbeat_ns=number_at(od, cia.HEARTBEAT_PRODUCER) * 1_000_000,
    )
