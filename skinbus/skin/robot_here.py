"""The robot in a process that reads contacts of a master elsewhere: joint positions come to it here.

What is published of a contact is its place on the skin. A reader that has the arm file, and joint positions
from its own program or from drives on the bus, places it in the frames of the robot as the master does.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import Frame
from skinbus.errors import LocalProtocolError
from skinbus.estimate import TrackState
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.skin.cycle import Cycle, Records
from skinbus.skin.feed import Positions

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class _Columns:
    """Some of the records of a cycle, as the columns that are placed."""

    def __init__(self, records: Records) -> None:
        self.link: Ints = records["link"].astype(np.int64)
        self.s: Floats = np.ascontiguousarray(records["s"])
        self.a: Floats = np.ascontiguousarray(records["a"])
        self.force: Floats = np.ascontiguousarray(records["force"])
        self.covariance: Floats = np.ascontiguousarray(records["covariance"])


@dataclass(frozen=True, slots=True)
class Placed:
    """Contacts of a cycle on the robot."""

    robot: RobotContacts
    rows: Ints
    """(n_contacts,) row of each record of the cycle in ``robot``; -1 of one that is not seen in the cycle."""


class RobotHere:
    """Takes joint positions as they come and places the contacts of cycles."""

    def __init__(self, arm: Arm) -> None:
        """Read the URDF of an arm.

        Raises:
            ConfigError: the URDF, the arm file that goes with it or the EDS of a drive has faults.
            SkinbusError: yourdfpy is not installed.
        """
        from skinbus.master.robot import MasterRobot  # nobody else pays for it

        self._robot = MasterRobot(arm)
        self._n_links = len(arm.links)
        self._sync_ns: int | None = None
        self._lock = threading.Lock()  # cycles may be read by several threads; kernels share their arrays

    def cob_ids_on(self, bus: int) -> frozenset[int]:
        """Return the identifiers of positions of drives on a bus, and of the SYNC that they answer."""
        return self._robot.cob_ids_on(bus) | {cia.SYNC_ID}

    def take(self, frames: Sequence[Frame]) -> None:
        """Take the positions in frames, each with the SYNC before it."""
        with self._lock:
            for frame in frames:
                if frame.can_id == cia.SYNC_ID:
                    self._sync_ns = frame.t_ns
                self._robot.take((frame,), self._sync_ns)

    def offer(self, t_ns: int, positions: Positions) -> None:
        """Take positions of a time from the program, from any thread."""
        self._robot.offer(t_ns, positions)

    def place(self, cycle: ReadCycle) -> Placed:
        """Return the contacts of a cycle on the robot, at the joint positions at its SYNC."""
        records = cycle.records
        is_seen = np.isin(records["state"], SEEN) & (records["link"] < self._n_links)
        rows = np.where(is_seen, np.cumsum(is_seen) - 1, -1)
        with self._lock:
            contacts = _Columns(records[is_seen])
            return Placed(self._robot.place(cycle.t_ns, contacts, is_blind=cycle.is_blind), rows)


SEEN = (TrackState.TOUCH, TrackState.HELD, TrackState.MOVE)
"""States of contacts that are seen in their cycle."""


def robot_here(arm: Arm | None) -> RobotHere | None:
    """Return the robot of an arm; None where it has none."""
    return RobotHere(arm) if arm is not None and arm.robot is not None else None


class ReadCycle(Cycle):
    """A cycle of a master elsewhere, on the robot where that is known here."""

    _robot_here: RobotHere | None = None
    is_blind = False
    """Whether nothing was read, as far as is known: that there are no torques is not known then."""

    def place_later_on(self, robot: RobotHere) -> None:
        """Place the contacts when they are asked for, by the joint positions that have come until then."""
        self._robot_here = robot

    def place_on(self, robot: RobotHere) -> None:
        """Place the contacts on the robot by the joint positions that have come."""
        self._placed = robot.place(self)

    @cached_property
    def _placed(self) -> Placed | None:
        return self._robot_here.place(self) if self._robot_here else None

    @property
    def robot(self) -> RobotContacts | None:
        """All that is known of the robot; None where nothing is."""
        return self._placed.robot if self._placed else None

    def _robot_rows(self) -> Ints | None:
        return self._placed.rows if self._placed else None


def offer_joints(robot: RobotHere | None, t_ns: int, positions: Positions) -> None:
    """Give joint positions of a time to a robot.

    Raises:
        LocalProtocolError: there is none.
        ArgumentError: positions that cannot be.
    """
    if robot is None:
        raise LocalProtocolError("joint positions need an arm file with [robot]: attach(NAME, arm=...)")
    robot.offer(t_ns, positions)
