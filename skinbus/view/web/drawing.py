"""What is drawn of one cycle: plain arrays of colours, arrows, lines and texts in the base frame, no browser.

Pressures are shown as they are known: a tactel without a fresh reading is grey, never the colour of zero.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm
from skinbus.skin.cycle import Contact, Cycle, PatchState, TrackState
from skinbus.skin.pressed import Loads
from skinbus.skin.touch import Touch
from skinbus.view.web import colours
from skinbus.view.web.colours import Colour, Colours
from skinbus.view.web.poses import Poses, placed, turned
from skinbus.view.web.solids import OVER, board_cross, board_outline

Floats = npt.NDArray[np.float64]

TRAIL_NS: Final = 2_000_000_000
"""How long the path of a contact stays."""
LEAST_N: Final = 0.05
"""Load of a board that is shown: 0.0 is none."""
SIGMAS: Final = 3.0
"""Standard deviations of the ellipse of a contact."""
LENGTH_PER_N: Final = 0.006
"""Length of an arrow, m/N: that of a firm push of 8 N is as long as a board."""
SHORTEST: Final = 0.014
LONGEST: Final = 0.09
"""Of an arrow, m: a light contact is seen, a hard one stays on the page; the label has the number."""
N_ELLIPSE: Final = 32
RING_RADIUS: Final = 0.006
"""Of the ring around a true touch, or one that was published, m: about a fingertip."""
LIFT: Final = 2.0 * OVER

CROSSED_OUT: Final = (PatchState.ABSENT, PatchState.SILENT, PatchState.WRONG, PatchState.UNUSED)
STALE_CYCLES: Final = 10
"""Periods without a new cycle, 0.2 s at 50 Hz, after which nothing that is shown is of now."""


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Line segments in the base frame."""

    points: Floats
    """(n, 2, 3) m."""
    colours: Colours
    """(n, 2, 3)"""

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, slots=True, eq=False)
class Arrows:
    """Arrows in the base frame, from their tail to their head."""

    points: Floats
    """(n, 2, 3) m."""
    colours: Colours
    """(n, 3)"""


@dataclass(frozen=True, slots=True)
class Label:
    """A text at a point of the base frame."""

    point: tuple[float, float, float]
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """One cycle as it is drawn."""

    number: int
    is_stale: bool
    tactels: tuple[Colours, ...]
    """By link, (n_tactels of the link, 3)."""
    outlines: Lines
    crosses: Lines
    """Lost boards."""
    suspects: Lines
    """Tactels that are not plausible."""
    forces: Arrows
    ellipses: Lines
    trails: Lines
    labels: tuple[Label, ...]
    true_forces: Arrows
    truths: Lines
    published: Lines
    """Rings where the master of a recording had its contacts, with a stroke along the normal by force."""
    n_lost: int
    n_suspect: int
    has_readings: bool

    def is_unlike(self, other: Drawing | None) -> bool:
        """Whether this is not the same as what was drawn before."""
        return other is None or (self.number, self.is_stale) != (other.number, other.is_stale)


class Drawer:
    """Draws the cycles of an arm, one after the other; it keeps the trails."""

    def __init__(self, arm: Arm, poses: Poses) -> None:
        self.full_pa = 1e3 * colours.FULL_KPA
        """Pressure of the brightest shade, Pa."""
        self._arm = arm
        self._numbers = {link.name: k for k, link in enumerate(arm.links)}
        self._trails: dict[int, deque[tuple[int, Floats]]] = {}
        self._outlines = np.array([board_outline(arm, p) for p in range(arm.n_patches)])
        self._crosses = np.array([board_cross(arm, p) for p in range(arm.n_patches)])
        self._tactels_of = [np.flatnonzero(arm.tactel_link == k) for k in range(len(arm.links))]
        self.poses = poses
        self._place(poses)

    def _place(self, poses: Poses) -> None:
        """Bring what lies on links into the base frame."""
        arm = self._arm
        X = poses.X_BS[arm.patch_link]
        R_transposed, there = X[:, None, :3, :3].swapaxes(-1, -2), X[:, None, None, :3, 3]
        self._outline = self._outlines @ R_transposed + there
        self._cross = self._crosses @ R_transposed + there
        n = arm.n_tactels
        self._tactel_cross = np.zeros((n, 2, 2, 3))
        for k, link in enumerate(arm.links):
            here = self._tactels_of[k]
            s, a = arm.tactel_s[here], arm.tactel_a[here]
            diameters = np.array([p.patch.diameter for p in arm.patches])[arm.tactel_patch[here]]
            r = 0.3 * diameters
            for d, (ds, da) in enumerate(((1.0, 1.0), (1.0, -1.0))):
                for end, sign in enumerate((-1.0, 1.0)):
                    points, normals = link.surface.position(s + sign * ds * r, a + sign * da * r)
                    self._tactel_cross[here, d, end] = placed(poses.X_BS[k], points + LIFT * normals)

    def move(self, poses: Poses) -> None:
        """Draw the links elsewhere from now on; trails stay where contacts were."""
        self.poses = poses
        self._place(poses)

    def forget(self) -> None:
        """Discard the trails: what comes next is of another time."""
        self._trails.clear()

    def draw(self, cycle: Cycle, *, age_s: float = 0.0) -> Drawing:
        """Return what is drawn of a cycle, whose readings are so old; a stale one is drawn as not known."""
        arm = self._arm
        is_stale = cycle.number == 0 or age_s > STALE_CYCLES / arm.bus.rate_hz
        readings = cycle.readings
        known = readings.valid & (not is_stale)
        tactels = np.where(
            known[:, None], colours.shades(readings.pressures, self.full_pa), np.array(colours.UNKNOWN)
        )
        states = [patch.state for patch in cycle.patches]
        lost = [p for p, state in enumerate(states) if state in CROSSED_OUT and cycle.number]
        suspect = np.flatnonzero(readings.faults)
        contacts = [] if is_stale else [c for c in cycle.contacts if c.state is not TrackState.LIFT]
        self._follow(cycle, contacts)
        return Drawing(
            number=cycle.number,
            is_stale=is_stale,
            tactels=tuple(tactels[here].astype(np.uint8) for here in self._tactels_of),
            outlines=self._outlines_of(states, is_stale),
            crosses=_lines(self._cross[lost], colours.LOST),
            suspects=_lines(list(self._tactel_cross[suspect]), colours.IMPLAUSIBLE),
            forces=self._arrows([(c.link, c.point, c.normal, c.force, _colour(c)) for c in contacts]),
            ellipses=self._ellipses(contacts),
            trails=self._trail_lines(cycle.t_ns),
            labels=tuple(self._label(c) for c in contacts),
            true_forces=self._arrows(
                [(t.link, t.point, t.normal, t.force, colours.TRUTH) for t in self._truth(cycle, is_stale)]
            ),
            truths=self._rings([(t.link, t.s, t.a) for t in self._truth(cycle, is_stale)], colours.TRUTH),
            published=self._published(cycle, is_stale),
            n_lost=len(lost),
            n_suspect=len(suspect),
            has_readings=bool(readings.valid.any()),
        )

    def _truth(self, cycle: Cycle, is_stale: bool) -> Sequence[Touch]:
        return () if is_stale else cycle.truth

    def _pose(self, link: str) -> Floats:
        return np.asarray(self.poses.X_BS[self._numbers[link]])

    def _outlines_of(self, states: Sequence[PatchState], is_stale: bool) -> Lines:
        """Return the outlines of boards that are not operational."""
        bad = [p for p, state in enumerate(states) if state is not PatchState.OPERATIONAL and not is_stale]
        tints = [colours.LOST if states[p] in CROSSED_OUT else colours.WAITING for p in bad]
        return _joined(self._outline[bad], tints)

    def _arrows(self, pushes: Iterable[tuple[str, Floats, Floats, float, Colour]]) -> Arrows:
        """Return arrows that push on the surface, with their heads where they do."""
        points, tints = [], []
        for link, point, normal, force, colour in pushes:
            if link not in self._numbers:
                continue
            X = self._pose(link)
            length = min(max(force * LENGTH_PER_N, SHORTEST), LONGEST)
            head = placed(X, point + LIFT * normal)
            points.append(np.stack([head + length * turned(X, normal), head]))
            tints.append(colour)
        return Arrows(np.array(points).reshape(-1, 2, 3), np.array(tints, np.uint8).reshape(-1, 3))

    def _label(self, contact: Contact) -> Label:
        X = self._pose(contact.link) if contact.link in self._numbers else np.eye(4)
        length = min(max(contact.force * LENGTH_PER_N, SHORTEST), LONGEST) + 0.006
        x, y, z = (placed(X, contact.point) + length * turned(X, contact.normal)).tolist()
        return Label((x, y, z), f"{contact.id}: {contact.force:.1f} N")

    def load_labels(self, loads: Loads) -> tuple[Label, ...]:
        """Return the loads of the boards that are pressed, at their centres."""
        arm, labels = self._arm, []
        for p in np.flatnonzero(loads.patches.force >= LEAST_N).tolist():
            k = int(arm.patch_link[p])
            point, normal = arm.links[k].surface.position(arm.patch_s[p], arm.patch_a[p])
            x, y, z = placed(self.poses.X_BS[k], point + LIFT * normal).tolist()
            sign = "\u2265 " if loads.at_least[p] else ""
            labels.append(Label((x, y, z), f"{sign}{loads.patches.force[p]:.1f} N"))
        return tuple(labels)

    def _ellipses(self, contacts: Iterable[Contact]) -> Lines:
        """Return the ellipses of contacts whose covariance is known."""
        angle = np.linspace(0.0, 2.0 * np.pi, N_ELLIPSE + 1)
        circle = np.stack([np.cos(angle), np.sin(angle)], -1)
        parts, tints = [], []
        for contact in contacts:
            if contact.covariance is None or contact.link not in self._numbers:
                continue
            place = np.asarray(contact.covariance)[:2, :2]
            if not np.isfinite(place).all():
                continue
            values, axes = np.linalg.eigh(place)
            offsets = circle * (SIGMAS * np.sqrt(np.maximum(values, 0.0))) @ axes.T
            loop = self._loop(contact.link, contact.s + offsets[:, 0], contact.a + offsets[:, 1])
            parts.append(loop)
            tints.append(_colour(contact))
        return _joined(parts, tints)

    def _published(self, cycle: Cycle, is_stale: bool) -> Lines:
        """Return rings and strokes of the contacts that a recording has."""
        records = cycle.published
        if records is None or is_stale:
            return _joined([], [])
        records = records[(records["state"] != TrackState.LIFT) & (records["link"] < len(self._arm.links))]
        names = [self._arm.links[k].name for k in records["link"].tolist()]
        rings = self._rings(
            list(zip(names, records["s"].tolist(), records["a"].tolist(), strict=True)), colours.PUBLISHED
        )
        arrows = self._arrows(
            [
                (name, record["point"], record["normal"], float(record["force"]), colours.PUBLISHED)
                for name, record in zip(names, records, strict=True)
            ]
        )
        strokes = Lines(arrows.points, np.repeat(arrows.colours[:, None], 2, 1))
        return Lines(
            np.concatenate([rings.points, strokes.points]), np.concatenate([rings.colours, strokes.colours])
        )

    def _rings(self, places: Iterable[tuple[str, float, float]], colour: Colour) -> Lines:
        """Return rings around places (link, s, a)."""
        angle = np.linspace(0.0, 2.0 * np.pi, N_ELLIPSE + 1)
        parts = [
            self._loop(link, s + RING_RADIUS * np.cos(angle), a + RING_RADIUS * np.sin(angle))
            for link, s, a in places
            if link in self._numbers
        ]
        return _lines(parts, colour)

    def _loop(self, link: str, s: Floats, a: Floats) -> Floats:
        """Return a line on the surface of a link as segments (n, 2, 3)."""
        k = self._numbers[link]
        points, normals = self._arm.links[k].surface.position(s, a)
        line = placed(self.poses.X_BS[k], points + LIFT * normals)
        return np.stack([line[:-1], line[1:]], 1)

    def _follow(self, cycle: Cycle, contacts: Iterable[Contact]) -> None:
        """Add where contacts are to their trails; a new contact with an old id begins a new one."""
        seen = set()
        for contact in contacts:
            if contact.link not in self._numbers:
                continue
            seen.add(contact.id)
            trail = self._trails.setdefault(contact.id, deque())
            if contact.state is TrackState.TOUCH:
                trail.clear()
            if not trail or cycle.t_ns > trail[-1][0]:
                trail.append(
                    (cycle.t_ns, placed(self._pose(contact.link), contact.point + LIFT * contact.normal))
                )
        for key, trail in list(self._trails.items()):
            if trail and trail[-1][0] > cycle.t_ns:  # time begins anew
                trail.clear()
            while trail and cycle.t_ns - trail[0][0] > TRAIL_NS:
                trail.popleft()
            if not trail and key not in seen:
                del self._trails[key]

    def _trail_lines(self, now_ns: int) -> Lines:
        """Return the trails, fading into the colour of boards."""
        parts, tints = [], []
        fresh, old = np.array(colours.CONTACT, float), np.array(colours.BOARD, float)
        for trail in self._trails.values():
            if len(trail) < 2:
                continue
            times = np.array([t for t, _ in trail], float)
            line = np.array([point for _, point in trail])
            share = np.clip((now_ns - times) / TRAIL_NS, 0.0, 1.0)[:, None]
            tint = ((1.0 - share) * fresh + share * old).astype(np.uint8)
            parts.append(np.stack([line[:-1], line[1:]], 1))
            tints.append(np.stack([tint[:-1], tint[1:]], 1))
        if not parts:
            return _joined([], [])
        return Lines(np.concatenate(parts), np.concatenate(tints))


def _colour(contact: Contact) -> Colour:
    return colours.COASTING if contact.state is TrackState.COAST else colours.CONTACT


def _lines(parts: Sequence[Floats], colour: Colour) -> Lines:
    return _joined(parts, [colour] * len(parts))


def _joined(parts: Sequence[Floats], tints: Sequence[Colour]) -> Lines:
    if not len(parts):
        return Lines(np.zeros((0, 2, 3)), np.zeros((0, 2, 3), np.uint8))
    counts = [len(part) for part in parts]
    each = np.repeat(np.array(tints, np.uint8), counts, 0)
    return Lines(np.concatenate(parts), np.repeat(each[:, None], 2, 1))
