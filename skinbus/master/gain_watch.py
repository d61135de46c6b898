"""Relative gains of a board from the contacts that happen anyway, whose places and forces are not known.

A contact on a board leaves residuals r of its readings against the law. A gain that is off by g_i adds
p_i g_i, and an error of place, force and width J dx. What the law misfits it misfits at each tactel alike, by
a factor h0(d) + w h1(d) + w^2 h2(d) over the distance d, unknown too, with the width w of the contact. What
is left when J is projected out informs of all::

    N <- f N + A^T A,   b <- f b + A^T r,   A = (1 - Q Q^T) p [1, h] / sigma,   Q R = J / sigma

so that gains and profiles are (N + prior)^-1 b; what one contact alone takes for its place falls out of A.
Weights fade by f with every contact.

Failure mode: a factor common to a board looks like force, and one that rises evenly across it like contacts
that lie elsewhere: gains are relative, and few tactels take more contacts (16: 1.3 % after 300 at best).
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Contacts, Quality
from skinbus.estimate.kernels.layout import limit_of
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]

CONTACT_NS: Final = 1_000_000_000
"""Between two contacts that are learned from: successive cycles see the same touch."""
FIRST: Final = 100
"""Contacts on a board after which its gains are the reference."""
SPARE: Final = 2
"""Readings that a contact must have beyond its own unknowns."""
PROFILE: Final = 10
"""Points of each profile of what the law misfits, ..."""
REACH_M: Final = 26e-3
"""... over this distance, m: four times the usual thickness of a cover."""
NUDGE: Final = 1e-4
"""m, of the derivatives: a hundredth of a pitch."""
WIDER: Final = 1.05
"""Factor of the derivative by the width."""
WIDTHS: Final = 0.1
"""By which widths of contacts differ, of the law's: as under tips of 4 to 16 mm."""
MOST_WIDTHS: Final = 2.0
"""Widths beyond count as if they were there: a square grows fast."""
DIGITS: Final = 6


class Terms(NamedTuple):
    """What counts as an error of a contact, not as one of gains."""

    misfit: float
    """Standard deviation of what law and profile leave, as a part of the pressure, ..."""
    foot: float
    """... and of the largest pressure."""
    share: float
    """Part of the largest pressure from which a tactel takes part: less is noise and the law's end."""
    profiles: int
    """Profiles: one, or as many as powers of the width, which is an unknown of the contact then."""
    gain_sd: float
    """Of gains before anything was seen."""
    profile_sd: float
    """Of the factor over the distance; 0: none."""
    keep: float
    """What a contact leaves of the weight of earlier ones."""


CHANGES: Final = Terms(0.05, 0.0, 0.03, 1, 0.2, 0.0, 1.0 - 1.0 / 300)
"""For gains that fail: contacts beside such a tactel are found elsewhere, by more than derivatives show; what
the law misfits cancels in the change since commissioning, as long as people touch the same places. A tactel
that fails shows within some hundred contacts."""
DIFFERENCES: Final = Terms(0.01, 0.005, 0.01, 3, 0.04, 0.3, 1.0 - 1.0 / 3000)
"""For gains that differ by some percent, under tips of 2 to 8 mm: the law errs by 30 % at its flank."""


class GainWatch:
    """Gains of the tactels of one board."""

    def __init__(self, n: int, terms: Terms = CHANGES) -> None:
        self.n = n
        self.terms = terms
        m = n + PROFILE * terms.profiles
        self.information = np.zeros((m, m))
        self.score = np.zeros(m)
        self.n_contacts = 0
        self.first: Floats | None = None
        """(n,) gains at commissioning."""

    def learn(self, law: Floats, d: Floats, slopes: Floats, readings: Floats, sigma: Floats) -> bool:
        """Take a contact, and return whether enough tactels felt it.

        law:      (n,) Pa, its pressures at distances d (n,) m
        slopes:   (n, k) their derivatives by the unknowns of the contact, its width the last
        readings: (n,) Pa or NaN, of standard deviation sigma (n,)
        """
        (use,) = np.nonzero(np.isfinite(readings) & (d < REACH_M))
        if len(use) < slopes.shape[1] + SPARE:
            return False
        scale = 1.0 / sigma[use]
        q, r = np.linalg.qr(slopes[use] * scale[:, None])
        left = (readings - law)[use] * scale
        known = q.T @ left
        width = (WIDER - 1.0) * known[-1] / r[-1, -1] if abs(r[-1, -1]) > 0.0 else 0.0
        width = float(np.clip(width / WIDTHS, -MOST_WIDTHS, MOST_WIDTHS))
        at = d[use] * (PROFILE - 1) / REACH_M
        point = at.astype(np.intp)
        rows, each = np.zeros((len(use), len(self.score))), np.arange(len(use))
        rows[each, use] = law[use] * scale
        for power in range(self.terms.profiles):
            first = self.n + PROFILE * power + point
            rows[each, first] = width**power * rows[each, use] * (1.0 - at + point)
            rows[each, first + 1] = width**power * rows[each, use] * (at - point)
        left -= q @ known
        rows -= q @ (q.T @ rows)
        self.information *= self.terms.keep
        self.score *= self.terms.keep
        self.information += rows.T @ rows
        self.score += rows.T @ left
        self.n_contacts += 1
        if self.n_contacts == FIRST:
            self.first = self.gains()[0]
        return True

    def gains(self) -> tuple[Floats, Floats]:
        """Return the gains relative to the calibration (0: as calibrated) and their sd, (n,)."""
        sds, counts = (
            [self.terms.gain_sd, max(self.terms.profile_sd, 1e-6)],
            [self.n, len(self.score) - self.n],
        )
        spread = np.repeat(sds, counts)
        inverse = np.asarray(np.linalg.inv(self.information + np.diag(spread**-2.0)), np.float64)
        return (inverse @ self.score)[: self.n], np.sqrt(np.diag(inverse))[: self.n]

    def changes(self) -> tuple[Floats, Floats]:
        """Return the changes of the gains since commissioning and their sd, (n,); NaN where not known."""
        if self.first is None or self.n_contacts < 2 * FIRST:
            return np.full(self.n, np.nan), np.full(self.n, np.nan)
        gains, sd = self.gains()
        change = gains - self.first
        return change - np.median(change), sd

    def as_table(self) -> dict[str, Any]:
        """Return it as numbers."""
        return {
            "contacts": self.n_contacts,
            "information": numbers_of(self.information[np.triu_indices(len(self.score))]),
            "score": numbers_of(self.score),
            "first": None if self.first is None else numbers_of(self.first),
        }

    @classmethod
    def of_table(cls, table: Any, n: int, terms: Terms = CHANGES) -> GainWatch | None:
        """Return what a table says, None if that is nothing whole."""
        if not isinstance(table, dict):
            return None
        found, contacts = cls(n, terms), table.get("contacts")
        m = len(found.score)
        information = column_of(table.get("information"), m * (m + 1) // 2)
        score, first = column_of(table.get("score"), m), column_of(table.get("first"), n)
        if information is None or score is None or not isinstance(contacts, int) or contacts < 0:
            return None
        upper = np.zeros((m, m))
        upper[np.triu_indices(m)] = information
        found.information = upper + np.triu(upper, 1).T
        if np.linalg.eigvalsh(found.information)[0] < -1e-3 * max(float(np.trace(found.information)), 1.0):
            return None
        found.score, found.first, found.n_contacts = score, first, contacts
        return found


def learn_gains(arm: Arm, watches: list[GainWatch], contacts: Contacts, pressures: Floats) -> None:
    """Let the boards with one contact learn from it; what is implausible is NaN in ``pressures``."""
    # a misfit is what a tactel whose gain has changed makes
    for c in alone(arm, contacts, int(Quality.MISFIT)):
        learn_contact(arm, watches[contacts.patch[c]], contacts, c, pressures)


def alone(arm: Arm, contacts: Contacts, allowed: int = 0) -> list[int]:
    """Return the contacts that are alone on their boards, and fitted without flags but those allowed."""
    good = (contacts.quality & ~allowed == 0) & (contacts.status == 0) & (contacts.level != "kmeans")
    few = np.bincount(contacts.patch, minlength=arm.n_patches)[contacts.patch] == 1
    return list(np.flatnonzero(good & few).tolist())


def learn_contact(arm: Arm, watch: GainWatch, contacts: Contacts, c: int, pressures: Floats) -> bool:
    """Let the board of a contact learn from it, and return whether it could."""
    p, terms = int(contacts.patch[c]), watch.terms
    here = arm.tactels_of(p)
    s, a, force = float(contacts.s[c]), float(contacts.a[c]), float(contacts.force[c])
    law = arm.patches[p].patch.law

    def pressed(ds: float = 0.0, da: float = 0.0, stronger: float = 1.0, wider: float = 1.0) -> Floats:
        d = arm.distance(here, s + ds, a + da)
        return np.asarray(law.pressure(d / (wider * arm.tactel_width[here]), stronger * force))

    model = pressed()
    steps = [pressed(ds=NUDGE), pressed(da=NUDGE), pressed(stronger=1.01)]
    if terms.profiles > 1:
        steps.append(pressed(wider=WIDER))
    slopes = np.stack(steps, -1) - model[:, None]
    read = pressures[here].copy()
    read[(model < terms.share * model.max()) | (read >= 0.95 * limit_of(arm)[here])] = np.nan
    sigma = np.sqrt(
        arm.tactel_noise[here] ** 2 + (terms.misfit * model) ** 2 + (terms.foot * model.max()) ** 2
    )
    d = arm.distance(here, s, a)
    return watch.learn(model, d, slopes, read, sigma)


def column_of(values: Any, n: int) -> Floats | None:
    """Return n finite numbers, None if there are not so many."""
    if not isinstance(values, list) or len(values) != n:
        return None
    if not all(isinstance(v, int | float) and abs(v) < 1e15 for v in values):
        return None
    return np.array(values, np.float64)


def numbers_of(column: Floats) -> list[float]:
    """Return numbers as they are kept."""
    return [float(f"{v:.{DIGITS}g}") for v in column.tolist()]
