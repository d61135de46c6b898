"""The report of one cycle: what it was estimated from, what was published, and what it cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Contacts, Loads, Tracks
from skinbus.master.level_control import CycleFlags

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleReport:
    """What one cycle came to, for those who watch."""

    t_ns: int
    """Time of its SYNC."""
    counter: int
    contacts: Contacts
    ids: npt.NDArray[np.int64]
    """(n_contacts,) identity as published, 0 for a contact without a slot."""
    tracks: Tracks
    """The same contacts with identities over time, and those that are not seen in this cycle."""
    loads: Loads
    pressures: npt.NDArray[np.float64]
    n_fresh: int
    fresh: npt.NDArray[np.bool_]
    """(n_patches,) whose readings are of this cycle."""
    compute_ns: int
    """Gather + estimate + publish, by the stopwatch."""
    latency_ns: int
    """From SYNC until the contact TPDOs were handed to the bus, computing included."""
    level: str
    """The most expensive level of this cycle; each contact says its own."""
    flags: CycleFlags
    budget_us: float | None
    """Most time that the estimator had; None for no limit."""
    robot: RobotContacts | None = None
    """The contacts in the frames of the robot; None without one."""
