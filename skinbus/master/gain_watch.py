"""Changes of gains since commissioning, from the contacts that happen anyway; nothing is corrected by them.

A contact on a board leaves residuals r of its readings against the law. A gain that is off by g_i adds
p_i g_i, and an error of place and force J dx; what is left when J is projected out informs of the gains::

    N <- f N + A^T A,   b <- f b + A^T r,   A = (1 - Q Q^T) diag(p / sigma),   Q R = J / sigma

so that the gains are (N + prior)^-1 b, whatever one contact alone cannot tell from its place. Weights fade
by f with every contact. A factor that is common to a board looks like force: gains are relative.

Failure mode: what the law misfits counts as gains. It cancels in the change since commissioning as long as
people touch the same places.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Contacts, Quality
from skinbus.estimate.kernels.layout import limit_of
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]

CONTACT_NS: Final = 1_000_000_000
"""Between two contacts that are learned from: successive cycles see the same touch."""
MEMORY: Final = 300
"""Contacts after which the weight of one has fallen to 1 / e."""
FIRST: Final = 100
"""Contacts on a board after which its gains are the reference."""
PRIOR_SD: Final = 0.2
"""Of a gain: tactels differ by 6 to 11 % before calibration."""
MISFIT: Final = 0.05
"""Standard deviation of what a law leaves, as a part of the pressure."""
SHARE: Final = 0.03
"""Part of the largest pressure of the law from which a tactel takes part: less is noise and the law's end."""
NUDGE: Final = 1e-4
"""m, of the derivatives: a hundredth of a pitch."""
DIGITS: Final = 6


class GainWatch:
    """Gains of the tactels of one board."""

    def __init__(self, n: int) -> None:
        self.information = np.zeros((n, n))
        self.score = np.zeros(n)
        self.n_contacts = 0
        self.first: Floats | None = None
        """(n,) gains at commissioning."""

    def learn(self, law: Floats, slopes: Floats, readings: Floats, sigma: Floats) -> None:
        """Take a contact: pressures of the law (n,), their derivatives (n, 3), readings or NaN, their sd."""
        use = np.isfinite(readings)
        scale = 1.0 / sigma[use]
        q, _ = np.linalg.qr(slopes[use] * scale[:, None])
        left = (readings - law)[use] * scale
        left -= q @ (q.T @ left)
        rows = np.diag(law[use] * scale)
        rows -= q @ (q.T @ rows)
        keep = 1.0 - 1.0 / MEMORY
        self.information *= keep
        self.score *= keep
        self.information[np.ix_(use, use)] += rows.T @ rows
        self.score[use] += rows.T @ left
        self.n_contacts += 1
        if self.n_contacts == FIRST:
            self.first = self.gains()[0]

    def gains(self) -> tuple[Floats, Floats]:
        """Return the gains relative to the calibration (0: as calibrated) and their sd, (n,)."""
        matrix = self.information + np.eye(len(self.score)) / PRIOR_SD**2
        inverse = np.asarray(np.linalg.inv(matrix), np.float64)
        return inverse @ self.score, np.sqrt(np.diag(inverse))

    def changes(self) -> tuple[Floats, Floats]:
        """Return the changes of the gains since commissioning and their sd, (n,); NaN where not known."""
        if self.first is None or self.n_contacts < 2 * FIRST:
            return np.full(len(self.score), np.nan), np.full(len(self.score), np.nan)
        gains, sd = self.gains()
        change = gains - self.first
        return change - np.median(change), sd

    def as_table(self) -> dict[str, Any]:
        """Return it as numbers."""
        return {
            "contacts": self.n_contacts,
            "information": _numbers(self.information[np.triu_indices(len(self.score))]),
            "score": _numbers(self.score),
            "first": None if self.first is None else _numbers(self.first),
        }

    @classmethod
    def of_table(cls, table: Any, n: int) -> GainWatch | None:
        """Return what a table says, None if that is nothing whole."""
        if not isinstance(table, dict):
            return None
        found, contacts = cls(n), table.get("contacts")
        information = _column(table.get("information"), n * (n + 1) // 2)
        score, first = _column(table.get("score"), n), _column(table.get("first"), n)
        if information is None or score is None or not isinstance(contacts, int) or contacts < 0:
            return None
        upper = np.zeros((n, n))
        upper[np.triu_indices(n)] = information
        found.information = upper + np.triu(upper, 1).T
        if np.linalg.eigvalsh(found.information)[0] < -1e-3 * max(float(np.trace(found.information)), 1.0):
            return None
        found.score, found.first, found.n_contacts = score, first, contacts
        return found


def learn_gains(arm: Arm, watches: list[GainWatch], contacts: Contacts, pressures: Floats) -> None:
    """Let the boards with one contact learn from it; what is implausible is NaN in ``pressures``."""
    # a misfit is what a tactel whose gain has changed makes
    good = (contacts.quality & ~int(Quality.MISFIT) == 0) & (contacts.status == 0)
    alone = np.bincount(contacts.patch, minlength=arm.n_patches)[contacts.patch] == 1
    for c in np.flatnonzero(good & alone & (contacts.level != "kmeans")).tolist():
        p = int(contacts.patch[c])
        here = arm.tactels_of(p)
        s, a, force = float(contacts.s[c]), float(contacts.a[c]), float(contacts.force[c])
        law = _law(arm, p, s, a, force)
        moved = (_law(arm, p, s + NUDGE, a, force), _law(arm, p, s, a + NUDGE, force))
        stronger = _law(arm, p, s, a, 1.01 * force)
        slopes = np.stack([(moved[0] - law) / NUDGE, (moved[1] - law) / NUDGE, stronger - law], -1)
        read = pressures[here].copy()
        read[(law < SHARE * law.max()) | (read >= 0.95 * limit_of(arm)[here])] = np.nan
        if np.isfinite(read).sum() > slopes.shape[1] + 1:
            sigma = np.hypot(arm.tactel_noise[here], MISFIT * law)
            watches[p].learn(law, slopes, read, sigma)


def _law(arm: Arm, p: int, s: float, a: float, force: float) -> Floats:
    here = arm.tactels_of(p)
    surface = arm.links[arm.patches[p].link].surface
    d = surface.distance(arm.tactel_s[here], arm.tactel_a[here], s, a)
    return np.asarray(arm.patches[p].patch.law.pressure(d / arm.tactel_width[here], force))


def _column(values: Any, n: int) -> Floats | None:
    if not isinstance(values, list) or len(values) != n:
        return None
    if not all(isinstance(v, int | float) and abs(v) < 1e15 for v in values):
        return None
    return np.array(values, np.float64)


def _numbers(column: Floats) -> list[float]:
    return [float(f"{v:.{DIGITS}g}") for v in column.tolist()]
