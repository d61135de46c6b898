"""The robot in the master: positions from Python, contacts in its frames, their objects.

Nothing of it is made for an arm without ``[robot]``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy.typing as npt

from skinbus.arrays import Floats, Ints
from skinbus.estimate import Contacts, Tracks
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import profile
from skinbus.robot import RobotContacts, RobotFrames
from skinbus.robot.chain import check_positions
from skinbus.robot.frames import to_single
from skinbus.robot.positions import JointPositions

FIRST, LAST = "Base x", "Tool fz"
"""First and last of the members of a contact record that are of the robot, in the order of the EDS."""
OFFERED = 64
"""Positions from Python that wait for the next cycle at most: those of a loop of 1 kHz at 20 Hz."""


class MasterRobot:
    """Takes joint positions as they come and, at the end of a cycle, writes what contacts do to the robot."""

    def __init__(self, arm: Arm, devices: Sequence[Device] = ()) -> None:
        """Read the URDF of an arm; objects are those of these nodes of the master.

        Raises:
            ConfigError: the URDF, or the arm file that goes with it, has faults.
            SkinbusError: yourdfpy is not installed.
        """
        assert arm.robot
        self.frames = RobotFrames(arm)
        self.positions = JointPositions(self.frames.chain, arm.robot)
        self._outputs = [_Objects(device, self.frames.chain.n_joints) for device in devices]
        # from another thread, taken when a cycle closes; a deque bears both ends
        self._offered: deque[tuple[int, Floats]] = deque(maxlen=OFFERED)
        self.clear()

    def offer(self, t_ns: int, positions: npt.ArrayLike | Mapping[str, float]) -> None:
        """Take positions of a time from Python, from any thread; see ``JointPositions.set``.

        Raises:
            ArgumentError: as that, and for positions beyond the limits of the URDF, as degrees are.
        """
        row = self.positions.resolve(positions)
        check_positions(self.frames.chain, row)
        self._offered.append((t_ns, row))

    def clear(self) -> None:
        """Write that nothing is known of the robot: there is no cycle now."""
        for output in self._outputs:
            output.clear()

    def close(self, t_ns: int, contacts: Contacts, tracks: Tracks, *, is_blind: bool) -> RobotContacts:
        """Place the contacts of the cycle of a SYNC at ``t_ns`` and write them to the objects.

        ``is_blind``: no patch has answered the SYNC; that nothing presses is not known then.
        """
        placed = self.place(t_ns, contacts, is_blind=is_blind)
        for output in self._outputs:
            output.write(placed, tracks.slot, tracks.row)
        return placed

    def place(self, t_ns: int, contacts: Any, *, is_blind: bool = False) -> RobotContacts:
        """Return contacts on the robot, at the joint positions of a time."""
        while self._offered:
            self.positions.put(*self._offered.popleft())
        at = None if is_blind else self.positions.at(t_ns)
        return self.frames.place(contacts, *(at or (None,)))


class _Objects:
    """The objects of the robot in one device."""

    def __init__(self, device: Device, n_joints: int) -> None:
        self._records = device.rows_of(profile.CONTACT, profile.MAX_CONTACTS)
        names = self._records.dtype.names or ()
        self._names = names[names.index(FIRST) : names.index(LAST) + 1]

        self._n_joints = device.view_of(profile.ROBOT_JOINTS, 1)
        self._is_valid = device.view_of(profile.ROBOT_VALID, 1)
        self._positions = device.view_of(profile.JOINT_POSITION, n_joints)
        self._wrench = device.view_of(profile.ROBOT_WRENCH, 6)

    def write(self, placed: RobotContacts, slots: Ints, rows: Ints) -> None:
        """Write the contacts in ``rows`` to the records in ``slots``, and what all of them do."""
        self.clear()  # a place of a contact that is not seen now would be that of another pose
        if not placed.valid:
            return
        is_seen = (rows >= 0) & (slots >= 0)
        slots = slots[is_seen]
        self._is_valid[0] = 1
        self._records["Robot valid"][slots] = 1
        for name, column in zip(self._names, placed.records()[rows[is_seen]].T, strict=True):
            self._records[name][slots] = column
        self._positions[:] = to_single(placed.positions)
        self._wrench[:] = to_single(placed.base_wrench)

    def clear(self) -> None:
        """Write that base and tool frame are not known."""
        for name in ("Robot valid", *self._names):
            self._records[name] = 0
        for column in (self._is_valid, self._positions, self._wrench):
            column[...] = 0
        self._n_joints[0] = len(self._positions)
