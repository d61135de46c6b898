"""One contact of one cycle as programs see it: its record, read where something of it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
import numpy.typing as npt

from skinbus.can.clock import Clock
from skinbus.estimate import LEVELS, Quality, TrackState
from skinbus.skin.layout import SkinLayout
from skinbus.skin.on_robot import Frame, OnRobot, Vector

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts

Floats = npt.NDArray[np.float64]

CONTACT: Final = np.dtype(
    [
        ("identity", "<i8"),
        ("seen_ns", "<i8"),
        ("id", "<u4"),
        ("link", "<u4"),
        ("state", "<u4"),
        ("quality", "<u4"),
        ("level", "<u4"),
        ("has_covariance", "<u4"),
        ("s", "<f8"),
        ("a", "<f8"),
        ("force", "<f8"),
        ("point", "<f8", 3),
        ("normal", "<f8", 3),
        ("covariance", "<f8", (3, 3)),
    ]
)
"""A contact as a record of 184 bytes: what shared memory holds, see ``docs/shared-memory.md``."""

_I8, _U4, _F8 = Struct("<q"), Struct("<I"), Struct("<d")
_AT: Final = {name: field[1] for name, field in (CONTACT.fields or {}).items()}
_IDENTITY, _SEEN_NS, _ID, _LINK, _STATE, _QUALITY, _LEVEL, _HAS_COVARIANCE, _S, _A, _FORCE = (
    _AT[name] for name in list(_AT)[:11]
)
"""Where the numbers of a record are in its bytes: one of them is read there when it is asked for."""

Records = npt.NDArray[Any]
"""(n,) of CONTACT or of PATCH."""

UNKNOWN_LEVEL: Final = 255
"""Level of a record of which neither level nor quality is known."""


class Now:
    """The time that ages count from: that of a clock, or without one the time at which a cycle ended."""

    __slots__ = ("_clock", "_ended_ns")

    def __init__(self, clock: Clock | None, ended_ns: int) -> None:
        self._clock = clock
        self._ended_ns = ended_ns

    def since(self, t_ns: int) -> float:
        """Return the time since then, s."""
        return 1e-9 * ((self._clock.now_ns() if self._clock else self._ended_ns) - t_ns)


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """What the contacts of one cycle share."""

    layout: SkinLayout
    now: Now
    records: Callable[[], Records]
    """Their records, with their places in space."""
    robot: RobotContacts | None
    rows: npt.NDArray[np.int64] | None
    """(n_contacts,) row of each in ``robot``; -1 of one that is not seen in the cycle."""


class Contact:
    """One contact of one cycle; its attributes cannot be set."""

    __slots__ = ("_at", "_data", "_k", "_shared")

    def __init__(self, data: bytes, at: int, k: int, shared: Shared) -> None:
        """``k`` is the number of its record, ``at`` where that begins in ``data``."""
        self._data = data
        self._at = at
        self._k = k
        self._shared = shared

    @property
    def id(self) -> int:
        """1..255, of no two contacts at a time."""
        return self._u4(_ID)

    @property
    def identity(self) -> int:
        """Counts from 1 and is never given twice; 0 where it is not known: from a bus."""
        return self._i8(_IDENTITY)

    @property
    def state(self) -> TrackState:
        """TOUCH first, then HELD or MOVE; COAST while it is not seen; LIFT once, when it has gone."""
        return TrackState(self._u4(_STATE))

    @property
    def link(self) -> str:
        """Name of the link in the arm file."""
        return link_name(self._shared.layout.links, self._u4(_LINK))

    @property
    def s(self) -> float:
        """Along the link, m."""
        return self._f8(_S)

    @property
    def a(self) -> float:
        """Arc length around it, m."""
        return self._f8(_A)

    @property
    def point(self) -> Vector:
        """(3,) m, in the frame of the link's surface, with a robot too; called it is in another frame.

        ``point("link")``, ``point("tool")``, and ``point()`` or ``point("base")``.
        """
        on_robot = self._on_robot
        return Vector.of(on_robot.point_S, on_robot.point)

    @property
    def normal(self) -> Vector:
        """(3,) outward unit normal, in the frame of the link's surface; called as ``point`` is."""
        on_robot = self._on_robot
        return Vector.of(on_robot.normal_S, on_robot.normal)

    @property
    def force(self) -> float:
        """Along the normal, N; tactels measure no shear."""
        return self._f8(_FORCE)

    @property
    def covariance(self) -> Floats | None:
        """(3, 3) of s, a (m) and force (N); None where it is not known: at level kmeans, and from a bus."""
        return np.asarray(self._record["covariance"]) if self._u4(_HAS_COVARIANCE) else None

    @property
    def quality(self) -> Quality | None:
        """Reasons why it may be wrong; None where it is not known: from a bus."""
        return Quality(self._u4(_QUALITY)) if self._u4(_LEVEL) < len(LEVELS) else None

    @property
    def level(self) -> str | None:
        """Level of the estimator that it comes from; None where it is not known: from a bus."""
        return LEVELS[self._u4(_LEVEL)] if self._u4(_LEVEL) < len(LEVELS) else None

    @property
    def seen_ns(self) -> int:
        """Time of the SYNC whose readings last showed it."""
        return self._i8(_SEEN_NS)

    @property
    def age_s(self) -> float:
        """Age of the readings that last showed it, s."""
        return self._shared.now.since(self._i8(_SEEN_NS))

    def force_vector(self, frame: Frame = "base") -> Floats:
        """Return the force on the skin in a frame, (3,) N: along the inward normal."""
        return -self.force * self._on_robot.normal(frame)

    def point_covariance(self, frame: Frame = "base") -> Floats | None:
        """Return the covariance of the point in frame "link", "base" or "tool", (3, 3) m^2.

        That of place on the surface and, but for "link", of the joint positions; None where it is not known.
        """
        covariance = self._on_robot.covariance(frame)
        return None if np.isnan(covariance).any() else covariance

    @property
    def jacobian(self) -> Floats:
        """(6, n_joints) of the point in the base: velocity, then angular velocity, by joint velocities."""
        return self._on_robot.jacobian()

    def lifted(self) -> Self:
        """Return it as it is when it has gone: with state LIFT and no force."""
        record = bytearray(self._data[self._at : self._at + CONTACT.itemsize])
        _U4.pack_into(record, _STATE, TrackState.LIFT)
        _F8.pack_into(record, _FORCE, 0.0)
        return type(self)(bytes(record), 0, self._k, self._shared)

    def __repr__(self) -> str:
        names = ("id", "identity", "state", "link", "s", "a", "force", "quality", "level", "seen_ns")
        return f"Contact({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    def _u4(self, offset: int) -> int:
        value: int = _U4.unpack_from(self._data, self._at + offset)[0]
        return value

    def _i8(self, offset: int) -> int:
        value: int = _I8.unpack_from(self._data, self._at + offset)[0]
        return value

    def _f8(self, offset: int) -> float:
        value: float = _F8.unpack_from(self._data, self._at + offset)[0]
        return value

    @property
    def _record(self) -> Any:
        return self._shared.records()[self._k]

    @property
    def _on_robot(self) -> OnRobot:
        shared, record, link = self._shared, self._record, self._u4(_LINK)
        X_LS = shared.layout.X_LS
        return OnRobot(
            record["point"],
            record["normal"],
            X_LS[link] if X_LS is not None and link < len(X_LS) else None,
            shared.layout.joints is not None,
            shared.robot,
            -1 if shared.rows is None else int(shared.rows[self._k]),
        )


def contacts_of(data: bytes, at: int, shared: Callable[[], Shared]) -> tuple[Contact, ...]:
    """Return the contacts whose records begin at ``at``; ``shared`` is asked for where there are some."""
    if len(data) <= at:
        return ()
    here, size = shared(), CONTACT.itemsize
    return tuple(Contact(data, at + k * size, k, here) for k in range((len(data) - at) // size))


def link_name(links: Sequence[str], number: int) -> str:
    """Return the name of a link; one that the arm file does not have is a number."""
    return links[number] if number < len(links) else str(number)
