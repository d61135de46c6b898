"""What a patch must be and be told, by its EDS."""

from __future__ import annotations

from dataclasses import dataclass

from canopen.objectdictionary import ObjectDictionary

from skinbus.master.boot import Identity
from skinbus.objects import cia
from skinbus.objects.dcf import Configuration, configuration
from skinbus.objects.profile import current


@dataclass(frozen=True, slots=True, kw_only=True)
class PatchPlan:
    """What a patch must be, what it must be told, and how often it gives a sign of life (0: never)."""

    node_id: int
    identity: Identity
    configuration: Configuration
    heartbeat_ns: int


def plan_of(node_id: int, od: ObjectDictionary) -> PatchPlan:
    """Return what a patch must be and be told by its EDS; an identity left out or zero is not asked for."""
    return PatchPlan(
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


def number_at(od: ObjectDictionary, index: int, sub: int = 0) -> int:
    """Return the number that a dictionary holds by its file, 0 when it has none there."""
    variable = od.get_variable(index, sub)
    return 0 if variable is None else int(current(variable) or 0)
