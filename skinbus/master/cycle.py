"""One cycle, pure: counts of the readings in, contacts out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Baseline, Contacts, Estimator, Tracker, Tracks
from skinbus.model import Arm
from skinbus.objects.readings import ReadingsPlan


class Cycle:
    """Calibrates counts, takes zeros off, estimates contacts and tracks them, in arrays allocated once.

    With ``zero_at_start`` the first readings of a patch are its zero, whatever touches it.
    """

    def __init__(
        self,
        arm: Arm,
        plan: ReadingsPlan,
        estimator: Estimator,
        tracker: Tracker,
        baseline: Baseline,
        *,
        zero_at_start: bool = False,
    ) -> None:
        self.arm = arm
        self.estimator = estimator
        self.tracker = tracker
        self.baseline = baseline
        self.pressures = np.zeros(arm.n_tactels)
        """(n_tactels,) Pa of the newest cycle, less the zeros; of stale patches old, and not used."""
        self._wants_zero = np.full(arm.n_patches, zero_at_start)
        self._offset = plan.counts_offset
        self._scale = plan.counts_scale * arm.tactel_gain

    def run(
        self,
        t_ns: int,
        counts: npt.NDArray[np.int32],
        fresh: npt.NDArray[np.bool_],
        level: str | None = None,
        budget_us: float | None = None,
    ) -> tuple[Contacts, Tracks]:
        """Return contacts and tracks of counts (n_tactels,), of which the ``fresh`` (n_patches,) count.

        ``level`` and ``budget_us`` are those of the estimator's cycle.
        """
        np.subtract(counts, self._offset, out=self.pressures)
        self.pressures *= self._scale
        self.baseline.apply(self.pressures, t_ns, fresh)
        if self._wants_zero.any():
            self._zero(fresh & self._wants_zero)
        contacts = self.estimator.update(
            self.pressures, t_ns, valid=fresh, baseline=self.baseline, level=level, budget_us=budget_us
        )
        return contacts, self.tracker.update(contacts, t_ns, fresh)

    def _zero(self, first: npt.NDArray[np.bool_]) -> None:
        """Make what these patches (n_patches,) read now their zero."""
        for p in np.flatnonzero(first).tolist():
            self.baseline.zero(p)
        self.pressures[first[self.arm.tactel_patch]] = 0.0
        self._wants_zero &= ~first
