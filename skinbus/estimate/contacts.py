"""What the estimator answers: contacts as columns, and a view of one contact for people."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats, Ints
from skinbus.estimate.kernels.workspace import Work

LEVELS: Final = ("kmeans", "fit", "full")
DEFAULT_LEVEL: Final = "fit"
"""At the limit of what the readings hold for single touches, in a tenth of the time of ``full``."""
_LEVEL_NAMES = np.array(LEVELS)


class Quality(enum.IntFlag):
    """Reasons why a contact may be less accurate than its covariance; 0 for none."""

    GOOD = 0
    FEW_TACTELS = 1
    """The place is uncertain by more than a quarter of the pitch: too few tactels feel the contact."""
    SATURATED = 2
    """A tactel at full scale took part: the force may be larger."""
    NOT_CONVERGED = 4
    """The fit did not end at a minimum."""
    MISFIT = 8
    """The law does not explain the readings within their noise."""
    OVER_BUDGET = 16
    """Time ran out: this is the answer of a cheaper level, or one that was not finished."""
    IMPAIRED = 32
    """A tactel that might feel it is not plausible, or not healthy, and counts as missing."""
    EXTENDED = 64
    """The contacts here do not add up to the load: what presses is wider than points, see ``Loads``."""
    RECOVERING = 128
    """What is left of a stronger press: a cover that recovers reads as much, and nothing may touch it."""


@dataclass(frozen=True, slots=True)
class Contact:
    """One contact, for people; the columns of :class:`Contacts` say what its fields are."""

    link: int
    s: float
    a: float
    force: float
    patch: int
    level: str
    n_tactels: int
    quality: Quality
    status: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contacts:
    """The contacts of one cycle; every column has n rows, and they stay as they are in later cycles.

    link        index of the link
    s, a        place on the chart of the link, m
    force       N
    patch       index of the patch of the nearest tactel; at level kmeans of the one that reads most
    level       "kmeans", "fit" or "full": what the place and force come from
    n_tactels   tactels that took part
    quality     :class:`Quality` flags
    status      outcome of the fit: 0 converged, 1 iteration limit
    size        u of what presses, see ``kernels.disc_shapes``; 0 where the law has no sizes
    residual    root mean square of (reading - law) / its deviation; 0 at level kmeans, which fits nothing
    covariance  (n, 3, 3) of s, a (m), force (N); zeros at level kmeans, which has none
    """

    t_ns: int
    link: Ints
    s: Floats
    a: Floats
    force: Floats
    patch: Ints
    level: npt.NDArray[np.str_]
    n_tactels: Ints
    quality: Ints
    status: Ints
    size: Floats
    residual: Floats
    covariance: Floats

    @classmethod
    def from_workspace(cls, work: Work, t_ns: int, unit: float) -> Self:
        """Return copies of the columns that the last cycle left in a workspace; ``unit`` is its length, m."""
        rows = work.alive[: work.n_contacts[0]].nonzero()[0]
        s, a, log_force, size = work.place.take(rows, 0).T.copy()
        covariance = work.covariance.take(rows, 0)
        if unit != 1.0:  # on boards of the usual size it is
            s, a = s * unit, a * unit
            covariance *= np.multiply.outer([unit, unit, 1.0], [unit, unit, 1.0])
        return cls(
            t_ns=t_ns,
            link=work.link[rows],
            s=s,
            a=a,
            force=np.exp(log_force),
            patch=work.patch[rows],
            level=_LEVEL_NAMES[work.level[rows]],
            n_tactels=work.n_tactels[rows],
            quality=work.quality[rows],
            status=work.status[rows],
            size=size,
            residual=work.residual[rows],
            covariance=covariance,
        )

    def __len__(self) -> int:
        return len(self.s)

    def __getitem__(self, i: int) -> Contact:
        row = {field.name: getattr(self, field.name)[i].item() for field in fields(Contact)}
        return Contact(**row | {"quality": Quality(row["quality"])})

    def __iter__(self) -> Iterator[Contact]:
        return (self[i] for i in range(len(self)))
