"""One contact of one cycle as programs see it, on the skin and in the frames of the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats, Ints
from skinbus.errors import ArgumentError, LocalProtocolError
from skinbus.estimate import LEVELS, Quality, TrackState
from skinbus.skin.layout import SkinLayout
from skinbus.skin.records import CONTACT as CONTACT
from skinbus.skin.records import UNKNOWN_LEVEL as UNKNOWN_LEVEL

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts

Records = npt.NDArray[Any]
"""(n,) of CONTACT or of PATCH."""
Level = Literal["kmeans", "fit", "full"]
"""Of the estimator."""
Frame = Literal["surface", "link", "base", "tool"]

NO_ROBOT = "joints, frames and torques need [robot] in the arm file, which attach(NAME, arm=...) needs too"
_ROWS = {"link": 0, "base": 1, "tool": 2}
"""Frames in the order of the arrays of ``RobotContacts``."""


class Placed(NamedTuple):
    """Contacts of a cycle on the robot."""

    robot: RobotContacts
    rows: Ints
    """(n_contacts,) row of each in ``robot``; -1 of one that is not seen in the cycle."""


@dataclass(eq=False)
class Context:
    """What the contacts and patches of one cycle share; it does not hold the cycle, which holds them."""

    layout: SkinLayout
    now_ns: Callable[[], int]
    """What ages count from: a clock, or without one the time at which the cycle ended."""
    place: Callable[[], Placed | None] | None = None
    """Places the contacts on the robot; called once, when that is first asked for."""

    @cached_property
    def placed(self) -> Placed | None:
        """The contacts on the robot; None where nothing is known of it."""
        return self.place() if self.place and self.layout.joints is not None else None

    def age_s(self, t_ns: int) -> float:
        """Return the time since then, s."""
        return 1e-9 * (self.now_ns() - t_ns)


class Vector(np.ndarray[Any, np.dtype[np.float64]]):
    """A vector (3,) in the frame of the link's surface; called, that in a frame, "base" by default."""

    _in: Callable[[Frame], Floats] | None = None

    def __call__(self, frame: Frame = "base") -> Floats:
        """Return the vector in frame "surface", "link", "base" or "tool", (3,)."""
        if self._in is None:
            raise TypeError("only the point and the normal of a contact are known in several frames")
        return self._in(frame)


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """One contact of one cycle."""

    id: int
    """1..255, of no two contacts at a time."""
    identity: int
    """Counts from 1 and is never given twice; 0 where it is not known: from a bus."""
    state: TrackState
    """TOUCH first, then HELD or MOVE; COAST while it is not seen; LIFT once, when it has gone."""
    link: str
    """Name of the link in the arm file."""
    s: float
    """Along the link, m."""
    a: float
    """Arc length around it, m."""
    force: float
    """Along the normal, N; tactels measure no shear."""
    quality: Quality | None
    """Reasons why it may be wrong; None where it is not known: from a bus."""
    level: str | None
    """Level of the estimator that it comes from; None where it is not known: from a bus."""
    seen_ns: int
    """Time of the SYNC whose readings last showed it."""
    covariance: Floats | None = field(repr=False)
    """(3, 3) of s, a (m) and force (N); None where it is not known: at level kmeans, and from a bus."""
    _record: Any = field(repr=False)
    _k: int = field(repr=False)
    _context: Context = field(repr=False)

    @classmethod
    def of(cls, record: Any, k: int, context: Context) -> Self:
        """Return the contact of the k-th record of a cycle."""
        identity, seen_ns, id, link, state, quality, level, has_covariance, s, a, force = record.item()[:11]
        is_known = level < len(LEVELS)
        return cls(
            id,
            identity,
            TrackState(state),
            link_name(context.layout.links, link),
            s,
            a,
            force,
            Quality(quality) if is_known else None,
            LEVELS[level] if is_known else None,
            seen_ns,
            record["covariance"] if has_covariance else None,
            record,
            k,
            context,
        )

    @property
    def point(self) -> Vector:
        """(3,) m, in the frame of the link's surface, with a robot too; called it is in another frame.

        ``point("link")``, ``point("tool")``, and ``point()`` or ``point("base")``.
        """
        return self._vector("point")

    @property
    def normal(self) -> Vector:
        """(3,) outward unit normal, in the frame of the link's surface; called as ``point`` is."""
        return self._vector("normal")

    @property
    def age_s(self) -> float:
        """Age of the readings that last showed it, s."""
        return self._context.age_s(self.seen_ns)

    def force_vector(self, frame: Frame = "base") -> Floats:
        """Return the force on the skin in a frame, (3,) N: along the inward normal."""
        return -self.force * self.normal(frame)

    def point_covariance(self, frame: Frame = "base") -> Floats | None:
        """Return the covariance of the point in frame "link", "base" or "tool", (3, 3) m^2.

        That of place on the surface and, but for "link", of the joint positions; None where it is not known.
        """
        if frame == "surface":
            raise ArgumentError("the covariance of a point is given in frame 'link', 'base' or 'tool'")
        covariance = self._on_robot("covariance", frame, (3, 3))
        return None if np.isnan(covariance).any() else covariance

    @property
    def jacobian(self) -> Floats:
        """(6, n_joints) of the point in the base: velocity, then angular velocity, by joint velocities."""
        return self._on_robot("jacobian", None, (6, len(self._context.layout.joints or ())))

    def lifted(self) -> Self:
        """Return it as it is when it has gone: with state LIFT and no force."""
        return replace(self, state=TrackState.LIFT, force=0.0)

    def _vector(self, name: str) -> Vector:
        vector = np.asarray(self._record[name], np.float64).view(Vector)
        vector._in = lambda frame: self._in(name, frame)
        return vector

    def _in(self, name: str, frame: Frame) -> Floats:
        """Return point or normal in a frame; NaN where it is not known."""
        value, X_LS = np.array(self._record[name]), self._context.layout.X_LS
        if frame == "surface":
            return value
        if frame != "link":
            return self._on_robot(name, frame, (3,))
        link = int(self._record["link"])
        if X_LS is None or link >= len(X_LS):
            raise LocalProtocolError("this source carries points in frame 'surface' only")
        X = X_LS[link]
        return np.asarray(X[:3, :3] @ value + (X[:3, 3] if name == "point" else 0.0))

    def _on_robot(self, name: str, frame: Frame | None, shape: tuple[int, ...]) -> Floats:
        """Return the row of a column of ``RobotContacts``, in a frame; NaN where it is not known."""
        if frame is not None and frame not in _ROWS:
            raise ArgumentError(f"no frame {frame!r}; wanted 'surface', 'link', 'base' or 'tool'")
        if self._context.layout.joints is None:
            raise LocalProtocolError(NO_ROBOT)
        placed = self._context.placed
        if placed is None or placed.rows[self._k] < 0:
            return np.full(shape, np.nan)
        row = getattr(placed.robot, name)[placed.rows[self._k]]
        return np.asarray(row if frame is None else row[_ROWS[frame]])


def link_name(links: Sequence[str], number: int) -> str:
    """Return the name of a link; one that the arm file does not have is a number."""
    return links[number] if number < len(links) else str(number)
