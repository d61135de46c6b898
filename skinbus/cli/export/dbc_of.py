"""The DBC of each bus of an arm: PDOs of its patches and of its master, with links, scales and places."""

from __future__ import annotations

from skinbus.config.system import ods_of
from skinbus.model import Arm
from skinbus.objects.dbc import DbcNode, Scale, dbc
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import Direction, PdoMap, rpdos, tpdos

MASTER = "master"


def dbc_of(arm: Arm, bus: int, node_id: int) -> str:
    """Return the DBC of one bus; ``node_id`` is that of the master, which publishes on all buses alike."""
    settings = arm.buses[bus]
    cycle_ms = round(1e3 / settings.rate_hz)
    devices = []
    ods = ods_of(arm)
    for p in range(*arm.patches_on(bus).indices(arm.n_patches)):
        placed, here = arm.patches[p], arm.tactels_of(p)
        step = placed.patch.transducer.step * arm.tactel_gain[here]
        scales = {
            k: Scale(float(factor), float(-offset * factor), "Pa")
            for k, (factor, offset) in enumerate(zip(step, arm.tactel_offset[here], strict=True), 1)
        }
        link = arm.links[placed.link].name
        comment = f"node {placed.node_id} on link {link} at s {1e3 * placed.s:g} mm, a {1e3 * placed.a:g} mm"
        pdos = _pdos(ods[p], [Direction.TPDO, Direction.RPDO])
        devices.append(
            DbcNode(
                name=f"patch_{placed.node_id}",
                comment=comment,
                od=ods[p],
                pdos=pdos,
                readings=scales,
                cycle_ms=cycle_ms,
            )
        )
    od = load_eds("skin-master", node_id)
    devices.append(
        DbcNode(
            name=MASTER,
            comment=f"node {node_id}: contacts and loads of {arm.name}",
            od=od,
            pdos=_pdos(od, [Direction.TPDO]),
            links=[link.name for link in arm.links],
        )
    )
    return dbc(devices, master=MASTER, bitrate=settings.bitrate, data_bitrate=settings.data_bitrate)


def _pdos(od: object, directions: list[Direction]) -> list[tuple[Direction, PdoMap]]:
    """Return the PDOs that are enabled and map something."""
    found = {Direction.TPDO: tpdos, Direction.RPDO: rpdos}
    return [
        (direction, pdo)
        for direction in directions
        for pdo in found[direction](od)  # type: ignore[arg-type]
        if pdo.valid and pdo.entries
    ]
