"""What is drawn of one cycle: plain arrays of colours, arrows, lines and texts in the base frame, no browser.

Pressures are shown as they are known: a tactel without a fresh reading is grey, never the colour of zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skinbus.arrays import Floats
from skinbus.model import Arm
from skinbus.skin.cycle import Contact, Cycle, PatchState, Touch, TrackState
from skinbus.view.web import colours
from skinbus.view.web.colours import Colour, Colours
from skinbus.view.web.poses import Poses, placed, turned

SIGMAS = 3.0
"""Standard deviations of the ellipse of a contact."""
LENGTH_PER_N = 0.006
"""Length of an arrow, m/N: that of a firm push of 8 N is as long as a board."""
SHORTEST = 0.014
LONGEST = 0.09
"""Of an arrow, m: a light contact is seen, a hard one stays on the page; the label has the number."""
ANGLES = np.linspace(0.0, 2.0 * np.pi, 33)
"""Of the points of an ellipse and of a ring."""
RING_RADIUS = 0.006
"""Of the ring around a true touch, m: about a fingertip."""
EDGE = np.array([(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1)])
CROSS = np.array([(1, 1), (0.5, 0.5), (0, 0), (-0.5, -0.5), (-1, -1)]) * 1.0
"""Of a board, in halves of its size: its edge, and one of its diagonals."""
LIFT = 1.6e-3
"""Height of lines over the surface, m: over boards and tactels."""

CROSSED_OUT = (PatchState.ABSENT, PatchState.SILENT, PatchState.WRONG, PatchState.UNUSED)
STALE_CYCLES = 10
"""Periods without a new cycle, 0.2 s at 50 Hz, after which nothing that is shown is of now."""


class Lines(NamedTuple):
    """Line segments, or arrows from their tail to their head, in the base frame."""

    points: Floats
    """(n, 2, 3) m."""
    colours: Colours
    """(n, 2, 3) of lines, (n, 3) of arrows."""


class Label(NamedTuple):
    """A text at a point of the base frame."""

    point: Floats
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """One cycle as it is drawn."""

    number: int
    is_stale: bool
    tactels: tuple[Colours, ...]
    """By link, (n_tactels of the link, 3)."""
    boards: Lines
    """Edges of boards that are not operational; lost ones are crossed out."""
    forces: Lines
    ellipses: Lines
    labels: tuple[Label, ...]
    true_forces: Lines
    truths: Lines
    has_readings: bool


class Drawer:
    """Draws the cycles of an arm."""

    def __init__(self, arm: Arm, poses: Poses) -> None:
        self.full_pa = 1e3 * colours.FULL_KPA
        """Pressure of the brightest shade, Pa."""
        self.poses = poses
        self._arm = arm
        self._numbers = {link.name: k for k, link in enumerate(arm.links)}

    def draw(self, cycle: Cycle, *, age_s: float = 0.0) -> Drawing:
        """Return what is drawn of a cycle, whose readings are so old; a stale one is drawn as not known."""
        arm, readings = self._arm, cycle.readings
        is_stale = cycle.number == 0 or age_s > STALE_CYCLES / arm.bus.rate_hz
        tactels = colours.shades(readings.pressures, self.full_pa)
        tactels[~readings.valid] = colours.UNKNOWN
        tactels[readings.faults != 0] = colours.LOST
        if is_stale:
            tactels[:] = colours.UNKNOWN
        contacts, truth = ((), ()) if is_stale else (cycle.contacts, cycle.truth)
        known = [c for c in contacts if c.state is not TrackState.LIFT and c.link in self._numbers]
        tints = [colours.COASTING if c.state is TrackState.COAST else colours.CONTACT for c in known]
        forces = self._arrows(known, tints)
        return Drawing(
            number=cycle.number,
            is_stale=is_stale,
            tactels=tuple(tactels[arm.tactel_link == k] for k in range(len(arm.links))),
            boards=self._boards([] if is_stale else [patch.state for patch in cycle.patches]),
            forces=forces,
            ellipses=self._ellipses(known, tints),
            labels=tuple(
                Label(1.1 * tail - 0.1 * head, f"{c.id}: {c.force:.1f} N")
                for c, (tail, head) in zip(known, forces.points, strict=True)
            ),
            true_forces=self._arrows(truth, [colours.TRUTH] * len(truth)),
            truths=_joined([(self._ring(t, RING_RADIUS * np.eye(2)), colours.TRUTH) for t in truth]),
            has_readings=bool(readings.valid.any()),
        )

    def _boards(self, states: Sequence[PatchState]) -> Lines:
        """Return the marks of boards that are not operational."""
        parts: list[tuple[Floats, Colour]] = []
        for state, board in zip(states, self._arm.patches, strict=False):
            if state is PatchState.OPERATIONAL:
                continue
            is_lost = state in CROSSED_OUT
            for shape in (EDGE, CROSS, CROSS * (1.0, -1.0)) if is_lost else (EDGE,):
                at = board.on_link(
                    self._arm.links[board.link].surface, 0.5 * np.array(board.patch.size) * shape
                )
                parts.append((self._line(board.link, *at), colours.LOST if is_lost else colours.WAITING))
        return _joined(parts)

    def _arrows(self, pushes: Sequence[Contact | Touch], tints: Sequence[Colour]) -> Lines:
        """Return arrows that push on the surface, with their heads where they do."""
        points = []
        for push in pushes:
            X = self.poses.X_BS[self._numbers[push.link]]
            head = placed(X, push.point + LIFT * push.normal)
            length = min(max(push.force * LENGTH_PER_N, SHORTEST), LONGEST)
            points.append([head + length * turned(X, push.normal), head])
        return Lines(np.array(points).reshape(-1, 2, 3), np.array(tints, np.uint8).reshape(-1, 3))

    def _ellipses(self, contacts: Sequence[Contact], tints: Sequence[Colour]) -> Lines:
        """Return the ellipses of contacts whose covariance is known."""
        parts = []
        for contact, tint in zip(contacts, tints, strict=True):
            if contact.covariance is None or not np.isfinite(place := contact.covariance[:2, :2]).all():
                continue
            values, axes = np.linalg.eigh(place)
            radii = SIGMAS * np.sqrt(np.maximum(values, 0.0))
            parts.append((self._ring(contact, axes * radii), tint))
        return _joined(parts)

    def _ring(self, push: Contact | Touch, axes: Floats) -> Floats:
        """Return an ellipse around a push, whose axes (2, 2) m are columns."""
        s, a = axes @ np.stack([np.cos(ANGLES), np.sin(ANGLES)])
        return self._line(self._numbers[push.link], push.s + s, push.a + a)

    def _line(self, link: int, s: Floats, a: Floats) -> Floats:
        """Return a line on the surface of a link, (n, 3)."""
        points, normals = self._arm.links[link].surface.position(s, a)
        return placed(self.poses.X_BS[link], points + LIFT * normals)


def _joined(parts: Sequence[tuple[Floats, Colour]]) -> Lines:
    """Return lines (n, 3), each of a colour, as segments."""
    points, tints = [np.zeros((0, 2, 3))], [np.zeros((0, 2, 3), np.uint8)]
    for line, tint in parts:
        points.append(np.stack([line[:-1], line[1:]], 1))
        tints.append(np.tile(np.array(tint, np.uint8), (len(line) - 1, 2, 1)))
    return Lines(np.concatenate(points), np.concatenate(tints))
