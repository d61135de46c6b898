"""What must hold in every hard case, and what a case asks on top; measured and judged for one level."""

import math
from functools import lru_cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from skinbus.estimate import LEVELS, Estimator, Quality
from tests.hard.ground import distance_to

SIGMAS = 6.0
"""A contact stands this near to a touch, in the standard deviations that it reports itself."""
ROUNDING = 2e-5
"""m: what a start, a stop of the fit at 3e-4 sigma and the arithmetic add where there is no noise."""
SEAM = 5e-3
"""m: a contact may stand beside its board, on the seam around it."""
WORK_PER_TACTEL = 200_000
"""Most pressures evaluated in one cycle, per tactel of the arm."""


class Situation(NamedTuple):
    """One cycle of a case: what the skin reads, and the truth behind it."""

    arm: object
    pressures: np.ndarray
    touches: list | None
    """None: no touch explains the readings. A touch of force 0 need not be found, but a contact there is no
    false one; NaN is an unknown force."""
    valid: np.ndarray | None = None
    felt: float | None = None
    """N that rest on the boards, where that is what a force is held against."""


class Must(NamedTuple):
    """What a case asks of kmeans, fit and full; one value stands for all three."""

    count: tuple = (1, 1)
    place: float | tuple = math.inf
    """m, the largest distance of a touch from its nearest contact."""
    force: float | tuple = math.inf
    """Relative error of the sum of all forces."""
    says: Quality = Quality.GOOD
    """fit and full raise one of these flags on every contact; GOOD asks for none."""
    kmeans_count: tuple | None = None


estimator_of = lru_cache(36)(Estimator)
"""Most cases are of the same arms: that no cycle leaves a trace is one of the things that must hold."""


def run_case(must, situation, level):
    """What a level makes of a situation, and its ``faults``, none if everything held."""
    arm, before = situation.arm, situation.pressures.copy()
    estimator = estimator_of(arm, level)
    contacts = estimator.update(situation.pressures, 1, situation.valid)
    work = estimator.n_evaluated
    faults = check_contacts(arm, contacts, level) + _check_same(estimator, situation, contacts)
    if not np.array_equal(before, situation.pressures, equal_nan=True):
        faults.append("the readings were written to")
    if work > WORK_PER_TACTEL * arm.n_tactels:
        faults.append(f"{work} pressures evaluated")
    most = 2 * arm.tactel_healthy.sum()
    if len(contacts) > most:
        faults.append(f"{len(contacts)} contacts on {most // 2} tactels")
    if level != "kmeans" and situation.touches is not None:
        faults += _check_claims(arm, contacts, situation.touches)
    place, force = _errors(situation, contacts)
    return SimpleNamespace(
        n=len(contacts),
        place=place,
        force=force,
        sd=max((sd_of_place(arm, contacts, c) for c in range(len(contacts))), default=0.0),
        quality=Quality(int(np.bitwise_or.reduce(contacts.quality, initial=0))),
        faults=faults + _check_must(must, LEVELS.index(level), contacts, place, force),
    )


def check_contacts(arm, contacts, level):
    """The faults of contacts that no readings excuse: not finite, off the skin, no covariance."""
    names = ("s", "a", "force", "size", "residual", "covariance")
    faults = [f"{name} is not finite" for name in names if not np.isfinite(getattr(contacts, name)).all()]
    if (contacts.force < 0.0).any():
        faults.append("a force below zero")
    off = max((off_skin(arm, c) for c in contacts), default=0.0)
    if off > 1e-9:
        faults.append(f"a contact is {1e3 * off:.3g} mm off the skin")
    if level == "kmeans":
        return (
            [*faults, "a covariance, which kmeans does not compute"] if contacts.covariance.any() else faults
        )
    for R in contacts.covariance:
        scale = np.sqrt(np.maximum(np.diag(R), 0.0))
        if not (np.array_equal(R, R.T) and (scale > 0.0).all()):
            faults.append("a covariance is not symmetric with a positive diagonal")
        elif np.linalg.eigvalsh(R / np.outer(scale, scale)).min() < -1e-12:
            faults.append("a covariance is not positive")
    return faults


def off_skin(arm, contact):
    """How far (m) a contact is off every board of its link and the seams around them; 0 on one."""
    off = [math.inf]
    for placed in arm.patches:
        if placed.link == contact.link:
            x, y = arm.links[contact.link].surface.develop(contact.s, contact.a, placed.a)
            at = complex(x - placed.s, y) * np.exp(-1j * placed.yaw)
            half_u, half_v = (0.5 * extent + SEAM for extent in placed.patch.size)
            off.append(max(abs(at.real) - half_u, abs(at.imag) - half_v, 0.0))
    return min(off)


def sd_of_place(arm, contacts, c):
    """The largest standard deviation (m) of the place of a contact on the surface."""
    surface = arm.links[contacts.link[c]].surface
    scale = np.array([1.0, float(surface.radius_at(contacts.s[c])) / surface.radius])
    R = contacts.covariance[c, :2, :2] * np.outer(scale, scale)
    return math.sqrt(max(float(np.linalg.eigvalsh(R)[-1]), 0.0))


def _check_claims(arm, contacts, touches):
    """Faults of contacts that are not where a touch is, or not as hard, within what they report."""
    faults = []
    nowhere = np.full(len(contacts), math.inf)
    d = np.min([nowhere, *(distance_to(arm, t, contacts) for t in touches)], axis=0)
    for c, off in enumerate(d):
        claimed = SIGMAS * sd_of_place(arm, contacts, c) + ROUNDING
        if off > claimed:
            faults.append(f"a contact is {1e3 * off:.3g} mm from a touch, reports {1e3 * claimed:.3g}")
    if len(contacts) == len(touches) == 1:
        off = abs(contacts.force[0] - touches[0][3])
        claimed = SIGMAS * math.sqrt(contacts.covariance[0, 2, 2]) + 1e-3 * touches[0][3]
        if off > claimed:
            faults.append(f"the force is off by {off:.3g} N, reports {claimed:.3g}")
    return faults


def _check_same(estimator, situation, contacts):
    """A fault if the same readings give another answer after other ones: no cycle leaves a trace."""
    estimator.update(situation.pressures[::-1], 2)
    again = estimator.update(situation.pressures, 3, situation.valid)
    names = ("link", "s", "a", "force", "patch", "n_tactels", "quality", "status", "residual", "covariance")
    same = all(np.array_equal(getattr(again, name), getattr(contacts, name)) for name in names)
    return [] if same else ["another answer to the same readings"]


def _errors(situation, contacts):
    """The largest distance of a touch from its nearest contact, and the error of the whole force."""
    touches = situation.touches or []
    truth = situation.felt if situation.felt is not None else sum(t[3] for t in touches)
    force = abs(float(contacts.force.sum()) - truth) / truth if truth > 0.0 else math.nan
    if not len(contacts):
        return math.nan, force
    d = [distance_to(situation.arm, t, contacts).min() for t in touches if t[3] != 0.0]
    return max(d, default=math.nan), force


def _check_must(must, rank, contacts, place, force):
    """Faults against what a case asks of the level of a rank."""
    faults = []
    low, high = must.kmeans_count if must.kmeans_count and rank == 0 else must.count
    if not low <= len(contacts) <= high:
        faults.append(f"{len(contacts)} contacts, wanted {low} to {high}")
    for name, off, bounds in (("place", place, must.place), ("force", force, must.force)):
        if off > np.broadcast_to(bounds, 3)[rank]:
            faults.append(f"{name} off by {off:.3g}, wanted {bounds}")
    if rank > 0 and must.says and not (contacts.quality & int(must.says)).all():
        faults.append(f"quality {contacts.quality.tolist()}, wanted one of {must.says!r} on each")
    return faults
