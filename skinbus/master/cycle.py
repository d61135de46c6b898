"""One cycle, pure: counts of the readings in, contacts and loads out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Floats, Ints, Ints32
from skinbus.estimate import (
    Baseline,
    Contacts,
    Estimator,
    LoadMeter,
    Loads,
    Plausibility,
    Quality,
    Tracker,
    Tracks,
)
from skinbus.master.level_control import CycleFlags
from skinbus.master.patches.table import Mask
from skinbus.model import Arm
from skinbus.objects.profile import MAX_CONTACTS
from skinbus.objects.readings import ReadingsPlan

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts

BLIND_S = 1.0
"""Longest time that a contact may be without readings of its patch and come back as the same, s; ..."""
BLIND_CYCLES = 3
"""... at low rates at least so many cycles."""
SHIFT_M = 0.4e-3
"""Standard deviation of the place along each axis by the tangential part of a push, m: 0.3 of the normal
force moves a fit by 0.8 mm, and 0.15 along each axis is usual."""

FORCE_SHARE = 0.25
"""Standard deviation of the force by what presses, for a law that was not measured on its board, where the
size of what presses is not estimated: that of the EDS errs by -12 % for a disc of 10 mm on an elastic layer,
-28 % of 6, -41 % of 3 mm."""

GAIN_SHARE = 0.1
"""Standard deviation of the force by the gains of a board on which nothing was measured: those of tactels of
real arrays scatter by 6 to 11 %, and what a board has in common is not known better."""
TIP_SHARE = 0.05
"""The same under a law that was measured on the board, with some tip: discs of 10 and 16 mm press otherwise
than one of 12 mm, and covers creep by some percent of what presses them."""

MISFIT_SHARE = 0.5
"""Standard deviation of the force of a contact that the law does not explain: where the tactel at its peak
reads nothing, a third of the force is left."""


LEAST_LEFT = 0.1
"""Share of a contact that may be left of an earlier press, from which on it is widened by it: less is within
the share of what presses."""
RECOVERING_SD = 3.0
"""A contact is RECOVERING within so many standard deviations of what a cover may still show."""


class CycleReport(NamedTuple):
    """What one cycle came to, for those who watch."""

    t_ns: int
    """Time of its SYNC."""
    counter: int
    contacts: Contacts
    ids: Ints
    """(n_contacts,) identity as published, 0 for a contact without a slot."""
    tracks: Tracks
    """The same contacts with identities over time, and those that are not seen in this cycle."""
    loads: Loads
    pressures: Floats
    n_fresh: int
    fresh: Bools
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


class Cycle:
    """Calibrates counts, subtracts zeros, estimates contacts and tracks them, in arrays allocated once.

    ``loads`` are those of the newest cycle; contacts that do not add up to them are EXTENDED.

    What a tactel that is not plausible reads is missing, to all levels.

    With ``zero_at_start`` the first readings of a patch are its zero, whatever touches it.
    """

    def __init__(
        self,
        arm: Arm,
        plan: ReadingsPlan,
        estimator: Estimator,
        *,
        zero_at_start: bool = False,
    ) -> None:
        self.arm = arm
        self.estimator = estimator
        longest_s = max(BLIND_S, BLIND_CYCLES / arm.bus.rate_hz)
        self.serials, self.zeroed_serials = np.zeros((2, arm.n_patches), np.int64)
        """(n_patches,) serial numbers of the boards, 0 for not known; and of those that the zeros are of."""
        self.tracker = Tracker(arm, n_slots=MAX_CONTACTS, blind_s=longest_s)
        self.baseline = Baseline(arm)
        self.plausibility = Plausibility(arm)
        self._load_meter = LoadMeter(arm)
        self.areas = self._load_meter.areas
        """(n_tactels,) m^2, by which pressures are multiplied in a load."""
        self.loads = self._load_meter.measure(np.zeros(arm.n_tactels), np.zeros(arm.n_tactels, np.int8))
        self.pressures = np.zeros(arm.n_tactels)
        """(n_tactels,) Pa of the newest cycle, less the zeros; of stale patches old, and not used."""
        self.valid: Bools
        """(n_tactels,) of them those that were used in the newest cycle."""
        self._wants_zero = np.full(arm.n_patches, zero_at_start)
        laws = [placed.patch.law for placed in arm.patches]
        measured = np.array([law.misfit_profile is not None for law in laws])
        self._is_real = measured | np.array([law.misfit > 0.0 for law in laws])  # an ideal law is exact
        self._is_unmeasured = self._is_real & ~measured
        self._offset = plan.counts_offset
        self.scale = plan.counts_scale
        """(n_tactels,) Pa per count, gain included."""

    def run(
        self,
        t_ns: int,
        counts: Ints32,
        fresh: Mask,
        level: str | None = None,
        budget_us: float | None = None,
        *,
        age_ns: npt.ArrayLike = 0,
    ) -> tuple[Contacts, Tracks]:
        """Return contacts and tracks of counts (n_tactels,), of which the ``fresh`` (n_patches,) count.

        ``level`` and ``budget_us`` are those of the estimator's cycle; ``age_ns`` (n_patches,) are the ages
        of the readings at ``t_ns``.
        """
        np.subtract(counts, self._offset, out=self.pressures)
        self.pressures *= self.scale
        is_new = (self.serials != 0) & (self.serials != self.zeroed_serials)
        for p in np.flatnonzero(is_new & (self.zeroed_serials != 0)).tolist():
            self.baseline.begin(p)
        self.zeroed_serials[is_new] = self.serials[is_new]
        self.plausibility.judge(self.pressures, t_ns, fresh, self.baseline)
        fresh = fresh & ~self.plausibility.is_withheld
        self.baseline.apply(self.pressures, t_ns, fresh)
        if self._wants_zero.any():
            self._zero(fresh & self._wants_zero)
        self.pressures[self.plausibility.faults != 0] = np.nan
        self.valid = np.isfinite(self.pressures) & self.arm.tactel_healthy
        contacts = self.estimator.update(
            self.pressures, t_ns, valid=fresh, baseline=self.baseline, level=level, budget_us=budget_us
        )
        meter, felt = self._load_meter, self.baseline.felt
        self.loads = meter.measure(self.pressures, felt.touched, fresh, baseline=self.baseline)
        meter.flag_extended(contacts, self.loads)
        self.pressures[~self.valid] = 0.0  # what is shown is finite
        self.valid &= fresh[self.arm.tactel_patch]
        if not self.valid.all():
            self._flag(contacts, ~self.valid)
        tracks = self.tracker.update(contacts, t_ns, fresh, age_ns)
        self._widen(contacts)
        self._doubt_what_is_left(contacts)
        return contacts, tracks

    def _widen(self, contacts: Contacts) -> None:
        """Add to covariances what tactels cannot show: the direction of a push, gains, what presses.

        It is common to all tactels of a contact and to all cycles: neither a fit nor a track shows it.
        """
        known = contacts.covariance[:, 2, 2] > 0.0  # of level ``kmeans`` nothing is
        rows = np.flatnonzero(known & (contacts.quality & Quality.MISFIT != 0))
        contacts.covariance[rows, 2, 2] += (MISFIT_SHARE * contacts.force[rows]) ** 2
        real = np.flatnonzero(known & self._is_real[contacts.patch])
        unmeasured = self._is_unmeasured[contacts.patch[real]]
        contacts.covariance[real, :2, :2] += SHIFT_M**2 * np.eye(2)
        share = np.where(unmeasured, GAIN_SHARE, TIP_SHARE)
        contacts.covariance[real, 2, 2] += (share * contacts.force[real]) ** 2
        rows = real[unmeasured & (contacts.size[real] == 0.0)]
        contacts.covariance[rows, 2, 2] += (FORCE_SHARE * contacts.force[rows]) ** 2

    def _doubt_what_is_left(self, contacts: Contacts) -> None:
        """Widen the force of contacts, and flag them, where a cover may still show an earlier press."""
        felt = self.baseline.felt
        if not ((felt.touched != 0) & (felt.creep > LEAST_LEFT * self.pressures)).any():
            return
        for c, here in enumerate(self._around(contacts)):
            read = float(self.pressures[here].sum())
            share = min(float(felt.creep[here].sum()) / read, 1.0) if read > 0.0 else 0.0
            if contacts.covariance[c, 2, 2] > 0.0:
                contacts.covariance[c, 2, 2] += (share * contacts.force[c]) ** 2
            if RECOVERING_SD * share >= 1.0:
                contacts.quality[c] |= Quality.RECOVERING

    def _flag(self, contacts: Contacts, missing: Mask) -> None:
        """Flag the contacts that a tactel of ``missing`` (n_tactels,) might have felt.

        It is near the contact, or beside one that feels it: without its peak a contact is found beside it.
        """
        beside = self.estimator.neighbours
        for c, around in enumerate(self._around(contacts)):
            if missing[np.concatenate([around, *(beside[i] for i in around)])].any():
                contacts.quality[c] |= Quality.IMPAIRED

    def _around(self, contacts: Contacts) -> Iterator[npt.NDArray[np.intp]]:
        """Yield for each contact its nearest tactel, and those of its neighbours that are touched."""
        arm, touched = self.arm, self.baseline.felt.touched
        for link, s, a in zip(contacts.link.tolist(), contacts.s, contacts.a, strict=True):
            (here,) = np.nonzero(arm.tactel_link == link)
            away = arm.links[link].surface.distance(arm.tactel_s[here], arm.tactel_a[here], s, a)
            nearest = here[np.argmin(away)]
            beside = self.estimator.neighbours[nearest]
            yield np.append(beside[touched[beside] != 0], nearest)

    def keep_zero(self, patch: int) -> None:
        """Do not make the first readings of a patch its zero: it has one."""
        self._wants_zero[patch] = False

    def _zero(self, first: Mask) -> None:
        """Make what these patches (n_patches,) read now their zero."""
        for p in np.flatnonzero(first).tolist():
            self.baseline.zero(p)
        self.pressures[first[self.arm.tactel_patch]] = 0.0
        self._wants_zero &= ~first
