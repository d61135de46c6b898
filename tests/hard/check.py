"""What must hold in every hard case, and what a case asks on top; measured and judged for one level."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import LEVELS, Contacts, Estimator, Quality
from skinbus.model import Arm
from tests.hard.ground import Ground, Touch, distance_to

Floats = npt.NDArray[np.float64]
Triple = tuple[float, float, float]
"""A bound for kmeans, fit and full."""

SIGMAS: Final = 6.0
"""A contact stands this near to a touch, in the standard deviations that it reports itself."""
ROUNDING: Final = 2e-5
"""m: what a start, a stop of the fit at 3e-4 sigma and the arithmetic add where there is no noise."""
SEAM: Final = 5e-3
"""m: a contact may stand beside its board, on the seam around it."""
WORK_PER_TACTEL: Final = 200_000
"""Most pressures evaluated in one cycle, per tactel of the arm."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Situation:
    """One cycle of a case: what the skin reads, and the truth behind it.

    ``touches`` None: no touch explains the readings, and only what ``Must`` says is asked.
    """

    arm: Arm
    pressures: Floats
    touches: Sequence[Touch] | None
    valid: npt.NDArray[np.bool_] | None = None
    felt: float | None = None
    """N that rest on the boards, where that is what a force is held against."""
    # A touch of force 0 need not be found, but a contact there is no false one. NaN is an unknown force.


@dataclass(frozen=True, slots=True, kw_only=True)
class Must:
    """What a case asks of kmeans, fit and full; one value stands for all three."""

    count: tuple[int, int] = (1, 1)
    place: float | Triple = math.inf
    """m, the largest distance of a touch from its nearest contact."""
    force: float | Triple = math.inf
    """Relative error of the sum of all forces."""
    says: Quality = Quality.GOOD
    """fit and full raise one of these flags on every contact; GOOD asks for none."""
    kmeans_count: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One row of the table."""

    name: str
    why: str
    holds: str
    must: Must
    build: Callable[[Ground], Situation | None]
    """None where the surface or the law has no such case."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one level made of a case on one ground; ``faults`` is empty when everything held."""

    n: int
    place: float
    force: float
    sigma_place: float
    """m, the largest that is reported; 0 at level kmeans."""
    quality: Quality
    work: int
    faults: tuple[str, ...]


def run_case(case: Case, ground: Ground, level: str) -> Outcome | None:
    """Return what a level makes of a case, None where it does not apply."""
    situation = case.build(ground)
    if situation is None:
        return None
    estimator = Estimator(situation.arm, level)
    before = situation.pressures.copy()
    contacts = estimator.update(situation.pressures, 1, situation.valid)
    work = estimator.n_evaluated
    faults = [*_check_always(situation, contacts, level), *_check_same(estimator, situation, contacts)]
    if not np.array_equal(before, situation.pressures, equal_nan=True):
        faults.append("the readings were written to")
    if work > WORK_PER_TACTEL * situation.arm.n_tactels:
        faults.append(f"{work} pressures evaluated")
    place, force = _errors(situation, contacts)
    quality = Quality(int(np.bitwise_or.reduce(contacts.quality, initial=0)))
    faults += _check_must(case.must, level, contacts, place, force)
    sigma = max((_sigma_place(situation.arm, contacts, c) for c in range(len(contacts))), default=0.0)
    return Outcome(
        n=len(contacts),
        place=place,
        force=force,
        sigma_place=sigma,
        quality=quality,
        work=work,
        faults=tuple(faults),
    )


def check_contacts(arm: Arm, contacts: Contacts, level: str) -> list[str]:
    """Return the faults of contacts that no readings excuse: not finite, off the skin, no covariance."""
    faults = []
    for name in ("s", "a", "force", "size", "residual", "covariance"):
        if not np.isfinite(getattr(contacts, name)).all():
            faults.append(f"{name} is not finite")
    if (contacts.force < 0.0).any():
        faults.append("a force below zero")
    for c in range(len(contacts)):
        off = off_skin(arm, int(contacts.link[c]), float(contacts.s[c]), float(contacts.a[c]))
        if off > 1e-9:
            faults.append(f"contact {c} is {1e3 * off:.3g} mm off the skin")
        R = contacts.covariance[c]
        if level == "kmeans":
            if R.any():
                faults.append("a covariance, which kmeans does not compute")
            continue
        scale = np.sqrt(np.maximum(np.diag(R), 0.0))
        if not (np.array_equal(R, R.T) and (scale > 0.0).all()):
            faults.append(f"covariance {c} is not symmetric with a positive diagonal")
        elif np.linalg.eigvalsh(R / np.outer(scale, scale)).min() < -1e-12:
            faults.append(f"covariance {c} is not positive")
    return faults


def off_skin(arm: Arm, link: int, s: float, a: float) -> float:
    """Return how far (m) a place is off every board of a link and the seams around them; 0 on one."""
    best = math.inf
    for placed in arm.patches:
        if placed.link != link:
            continue
        surface = arm.links[link].surface
        x, y = (float(v) for v in surface.develop(s, a, placed.a))
        x -= placed.s
        cos, sin = math.cos(placed.yaw), math.sin(placed.yaw)
        u, v = cos * x + sin * y, cos * y - sin * x
        half_u, half_v = (0.5 * extent + SEAM for extent in placed.patch.size)
        best = min(best, max(abs(u) - half_u, abs(v) - half_v, 0.0))
    return best


def _check_always(situation: Situation, contacts: Contacts, level: str) -> list[str]:
    arm = situation.arm
    faults = check_contacts(arm, contacts, level)
    most = 2 * int(arm.tactel_healthy.sum())
    if len(contacts) > most:
        faults.append(f"{len(contacts)} contacts on {most // 2} tactels")
    if level == "kmeans" or situation.touches is None:
        return faults
    # a contact is where a touch is, within what it reports
    for c in range(len(contacts)):
        d = min(
            (
                float(distance_to(arm, t, contacts.link[c], contacts.s[c], contacts.a[c]))
                for t in situation.touches
            ),
            default=math.inf,
        )
        claimed = SIGMAS * _sigma_place(arm, contacts, c) + ROUNDING
        if d > claimed:
            faults.append(f"contact {c} is {1e3 * d:.3g} mm from a touch, reports {1e3 * claimed:.3g}")
    if len(contacts) == len(situation.touches) == 1:
        off = abs(float(contacts.force[0]) - situation.touches[0][3])
        claimed = SIGMAS * math.sqrt(float(contacts.covariance[0, 2, 2])) + 1e-3 * situation.touches[0][3]
        if off > claimed:
            faults.append(f"the force is off by {off:.3g} N, reports {claimed:.3g}")
    return faults


def _check_same(estimator: Estimator, situation: Situation, contacts: Contacts) -> list[str]:
    """Return a fault if the same readings give another answer after other ones: no cycle leaves a trace."""
    estimator.update(situation.pressures[::-1], 2)
    again = estimator.update(situation.pressures, 3, situation.valid)
    names = ("link", "s", "a", "force", "patch", "n_tactels", "quality", "status", "residual", "covariance")
    same = len(again) == len(contacts) and all(
        np.array_equal(getattr(again, name), getattr(contacts, name)) for name in names
    )
    return [] if same else ["another answer to the same readings"]


def _errors(situation: Situation, contacts: Contacts) -> tuple[float, float]:
    """Return the largest distance of a touch from its nearest contact, and the error of the whole force."""
    touches = situation.touches or []
    truth = situation.felt if situation.felt is not None else sum(t[3] for t in touches)
    force = abs(float(contacts.force.sum()) - truth) / truth if truth > 0.0 else math.nan
    if not touches or not len(contacts):
        return math.nan, force
    d = [
        distance_to(situation.arm, t, contacts.link, contacts.s, contacts.a).min()
        for t in touches
        if t[3] != 0.0
    ]
    return float(max(d)), force


def _check_must(must: Must, level: str, contacts: Contacts, place: float, force: float) -> list[str]:
    rank = LEVELS.index(level)
    low, high = must.kmeans_count if must.kmeans_count and rank == 0 else must.count
    faults = []
    if not low <= len(contacts) <= high:
        faults.append(f"{len(contacts)} contacts, wanted {low} to {high}")
    if place > bound_of(must.place, rank):
        faults.append(f"place off by {1e3 * place:.3g} mm, wanted {1e3 * bound_of(must.place, rank):.3g}")
    if force > bound_of(must.force, rank):
        faults.append(f"force off by {100 * force:.3g} %, wanted {100 * bound_of(must.force, rank):.3g}")
    if rank > 0 and must.says and not (contacts.quality & int(must.says)).all():
        faults.append(f"quality {contacts.quality.tolist()}, wanted one of {must.says!r} on each")
    return faults


def bound_of(bound: float | Triple, rank: int) -> float:
    """Return the bound for a level."""
    return bound[rank] if isinstance(bound, tuple) else bound


def _sigma_place(arm: Arm, contacts: Contacts, c: int) -> float:
    """Return the largest standard deviation of the place of a contact on the surface, m."""
    surface = arm.links[int(contacts.link[c])].surface
    scale = float(surface.radius_at(contacts.s[c])) / surface.radius
    R = contacts.covariance[c, :2, :2] * np.array([[1.0, scale], [scale, scale * scale]])
    return math.sqrt(max(float(np.linalg.eigvalsh(R)[-1]), 0.0))
