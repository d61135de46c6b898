"""Drives of an arm: the position of a joint in the TPDOs of its drive, found in the drive's EDS or DCF."""

from __future__ import annotations

from typing import NamedTuple

from skinbus.errors import EdsError, Fault
from skinbus.model import Arm, JointSettings
from skinbus.objects.drives import DrivePosition, drive_position
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import MASTER_NODE_ID


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
            wanted = "0x6064 (position actual value) in a valid TPDO with a COB-ID of 11 bits"
            raise EdsError(joint.eds, [Fault("TPDOs", None, wanted)])
        drives.append(Drive(joint, position))
    return drives


def check_drives(arm: Arm, taken: dict[tuple[int, int], str], faults: list[Fault]) -> None:
    """Add the faults of drives: their files, node-IDs and COB-IDs that are ``taken`` by (bus, COB-ID)."""
    nodes = {(placed.bus, placed.node_id): "a patch" for placed in arm.patches}
    for joint in arm.robot.joints if arm.robot else ():
        if joint.node_id is None:
            continue
        owner = nodes.get((joint.bus, joint.node_id))
        if joint.node_id == MASTER_NODE_ID or owner:
            has = owner or "the master"
            faults.append(Fault(f"{joint.key}.node_id", joint.node_id, f"another: {has} has it"))
        nodes.setdefault((joint.bus, joint.node_id), joint.key)
        try:
            position = drive_position(load_eds(joint.eds, joint.node_id))
        except EdsError as error:
            faults += [
                Fault(f"{joint.key}.eds {error.file} {fault.key}", fault.seen, fault.wanted)
                for fault in error.faults
            ]
            continue
        if position is None:
            wanted = "0x6064 (position actual value) in a valid TPDO with a COB-ID of 11 bits"
            faults.append(Fault(f"{joint.key}.eds {joint.eds}", None, wanted))
            continue
        by = taken.setdefault((joint.bus, position.cob_id), joint.key)
        if by != joint.key:
            cob_id = f"COB-ID 0x{position.cob_id:03X}"
            faults.append(Fault(f"{joint.key}.eds {joint.eds}", cob_id, f"another: {by} has it"))
