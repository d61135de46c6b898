"""The robot in a process that reads contacts of a master elsewhere: joint positions come to it here.

What is published of a contact is its place on the skin. A reader that has the arm file, and joint positions
from its own program, places it in the frames of the robot as the master does.
"""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np

from skinbus.estimate import TrackState
from skinbus.model import Arm
from skinbus.skin.contact import Placed, Records

SEEN = (TrackState.TOUCH, TrackState.HELD, TrackState.MOVE)
"""States of contacts that are seen in their cycle."""


class RobotHere:
    """Takes joint positions as they come and places the contacts of cycles; none without ``[robot]``."""

    def __init__(self, arm: Arm | None) -> None:
        """Read the URDF of an arm.

        Raises:
            ConfigError: the URDF, or the arm file that goes with it, has faults.
            SkinbusError: yourdfpy is not installed.
        """
        self.robot = None
        """What takes joint positions; None without ``[robot]``."""
        if arm is not None and arm.robot:
            from skinbus.master.robot import MasterRobot  # nobody else pays for it

            self.robot = MasterRobot(arm)
        self._n_links = len(arm.links) if arm else 0
        self._lock = threading.Lock()  # cycles may be read by several threads; kernels share their arrays

    def place(self, t_ns: int, records: Records, is_blind: bool = False) -> Placed | None:
        """Return contacts (of CONTACT) on the robot, at the joint positions at a SYNC.

        ``is_blind``: nothing was read; that there are no torques is not known then.
        """
        if self.robot is None:
            return None
        is_seen = np.isin(records["state"], SEEN) & (records["link"] < self._n_links)
        seen = records[is_seen]
        columns = {name: np.ascontiguousarray(seen[name]) for name in ("s", "a", "force", "covariance")}
        contacts = SimpleNamespace(link=seen["link"].astype(np.int64), **columns)
        with self._lock:
            robot = self.robot.place(t_ns, contacts, is_blind=is_blind)
        return Placed(robot, np.where(is_seen, np.cumsum(is_seen) - 1, -1))
