"""Drives of an arm: the position of a joint in the TPDOs of its drive, found in the drive's EDS or DCF."""

from __future__ import annotations

from typing import Final, NamedTuple

from skinbus.errors import EdsError, Fault
from skinbus.model import Arm, JointSettings
from skinbus.objects.drives import DrivePosition, drive_position
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import rpdos, tpdos
from skinbus.objects.profile import MASTER_NODE_ID

POSITION_WANTED: Final = "0x6064 (position actual value) in a valid TPDO with a COB-ID of 11 bits"


class Drive(NamedTuple):
    """A joint, and where its drive sends its position."""

    joint: JointSettings
    position: DrivePosition


def drives_of(arm: Arm) -> list[Drive]:
    """Return the drives of the joints of an arm; none without a robot.

    Raises:
        EdsError: a file has faults, or maps no position.
    """
    drives = []
    for joint in arm.robot.joints if arm.robot else ():
        if joint.node_id is None:
            continue
        position = drive_position(load_eds(joint.eds, joint.node_id))
        if position is None:
            raise EdsError(joint.eds, [Fault("TPDOs", None, POSITION_WANTED)])
        drives.append(Drive(joint, position))
    return drives


def check_drives(arm: Arm, taken: dict[tuple[int, int], str], faults: list[Fault]) -> None:
    """Add the faults of drives: their files, node-IDs, and PDOs on the identifier of another sender.

    taken: who of the skin sends on an identifier, by (bus, COB-ID).
    """
    senders = dict(taken)
    nodes = {(placed.bus, placed.node_id): "a patch" for placed in arm.patches}
    nodes |= {(k, MASTER_NODE_ID): "the master" for k in range(len(arm.buses))}
    for joint in arm.robot.joints if arm.robot else ():
        if joint.node_id is None:
            continue
        owner = nodes.setdefault((joint.bus, joint.node_id), joint.key)
        if owner != joint.key:
            faults.append(Fault(f"{joint.key}.node_id", joint.node_id, f"another: {owner} has it"))
            continue  # its identifiers follow from it
        key = f"{joint.key}.eds {joint.eds}"
        try:
            od = load_eds(joint.eds, joint.node_id)
        except EdsError as error:
            of_file = f"{joint.key}.eds {error.file}"
            faults += [Fault(f"{of_file} {fault.key}", fault.seen, fault.wanted) for fault in error.faults]
            continue
        if drive_position(od) is None:
            faults.append(Fault(key, None, POSITION_WANTED))
        for pdo in tpdos(od):
            if not pdo.valid or pdo.extended:
                continue
            sender = senders.setdefault((joint.bus, pdo.cob_id), joint.key)
            if sender != joint.key:
                seen = f"COB-ID 0x{pdo.cob_id:03X}"
                faults.append(Fault(f"{key} TPDO {pdo.number}", seen, f"another: {sender} has it"))
        for pdo in rpdos(od):
            owner = taken.get((joint.bus, pdo.cob_id), "")
            if pdo.valid and not pdo.extended and owner:
                wanted = f"another: {owner} sends on it, and the drive would obey"
                faults.append(Fault(f"{key} RPDO {pdo.number}", f"COB-ID 0x{pdo.cob_id:03X}", wanted))
