"""Load of a bus by the PDOs of an arm: worst-case frame times and the share that one cycle takes."""

from __future__ import annotations

from collections.abc import Sequence

from canopen.objectdictionary import ObjectDictionary

from skinbus.can import classic, fd
from skinbus.can.fd import CLASSIC_BYTES as CLASSIC_BYTES
from skinbus.model import Arm, BusSettings
from skinbus.objects.pdo import carries_readings, tpdos
from skinbus.objects.published import master_tpdos

MAX_LOAD = 0.8
"""Share of the bus that cyclic traffic may take (docs/bus.md)."""


def cyclic_load(arm: Arm, ods: Sequence[ObjectDictionary], bus: int = 0) -> float:
    """Return the share of a bus that one cycle takes at worst, 0 to 1 and more.

    Counted are SYNC with counter, TPDOs of the patches with readings and those of the master, each with the
    worst bit stuffing.
    """
    own = [pdo for od in ods[arm.patches_on(bus)] for pdo in tpdos(od) if carries_readings(pdo)]
    own += [pdo for pdo in master_tpdos() if pdo.valid]
    lengths = [1, *(pdo.length for pdo in own)]
    return 1e-9 * sum(worst_ns(n, arm.buses[bus]) for n in lengths) * arm.buses[bus].rate_hz


def worst_ns(n_bytes: int, bus: BusSettings) -> int:
    """Return the time of a frame with the worst stuffing, ns; more than 8 bytes are a CAN FD frame."""
    if n_bytes > CLASSIC_BYTES:
        return fd.worst_case_bits(n_bytes).ns(bus.bitrate, bus.data_bitrate or bus.bitrate)
    return -(-classic.worst_case_bits(n_bytes) * 1_000_000_000 // bus.bitrate)
