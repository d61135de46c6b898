"""Simulated drives: after each SYNC, the position of a joint in the TPDO that the drive's EDS maps."""

from __future__ import annotations

from skinbus.can.frame import Frame
from skinbus.config.drives import drives_of
from skinbus.model import Arm
from skinbus.sim.joint_motion import JointMotion


class Drives:
    """The drives of the joints of an arm; what else its TPDO maps is 0."""

    def __init__(self, arm: Arm, motion: JointMotion) -> None:
        self._motion = motion
        self._drives = [(motion.names.index(drive.joint.name), drive) for drive in drives_of(arm)]

    def frames(self, bus: int, t_s: float) -> list[Frame]:
        """Return what the drives on a bus send of a scene time."""
        positions = self._motion.positions(t_s)
        return [
            Frame(
                drive.position.cob_id,
                drive.position.frame_of(
                    round((positions[joint] - drive.joint.offset) * drive.joint.counts_per_unit)
                ),
            )
            for joint, drive in self._drives
            if drive.joint.bus == bus
        ]
