"""The dialogue that finds which board sits at which place: pressures and answers in, lines to show out.

A person presses each place: its centre, then two of its corners. The board that is pressed belongs there, and
the corners show how it is turned and whether it is mirrored. A press that does not fit what was asked for is
named and asked for again; nothing is guessed.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.master.commissioning.press_dialogue import HELP, Board, HandPress, PressDialogue

CORNERS = (complex(1, 1), complex(-1, 1))
"""The two that are pressed after the centre, in halves of the size of a board: they are not opposite, so
that a mirrored board differs from a turned one."""
INSIDE = 0.7
"""Part of the way to a corner where a finger presses: on tactels of the board, none of a neighbour."""

SNAP = math.radians(20.0)
"""A board is mounted as planned or by quarters of a turn from it; fingers a third of a pitch off, 5 mm at
18 mm from the centre, err by less."""
FITS = 0.9
"""Correlation from which presses have the shape of the points that were asked for; ..."""
MIRRORED_FITS_LESS = 0.2
"""... by so much at least more than those of the mirrored board, whose is 0.5."""


def corner(size: tuple[float, float], yaw: float, which: int) -> complex:
    """Return where a corner is pressed: from the centre along s, and i times across, m."""
    c = CORNERS[which]
    return 0.5 * INSIDE * complex(c.real * size[0], c.imag * size[1]) * complex(math.cos(yaw), math.sin(yaw))


def fit_turn(
    felt: Sequence[complex], pressed: Sequence[complex], planned: float
) -> tuple[float, bool] | None:
    """Return the yaw of a board, rad in (-pi, pi], and whether it is mirrored; None if unclear.

    It felt presses at u + iv where it was pressed at s + ia, and sits as ``planned`` or by quarters of a turn
    from that. Scale does not matter: a centre of pressure lies further in than the finger.
    """
    target = np.asarray(pressed) - np.mean(pressed)
    fits = []
    for mirrored in (False, True):
        x = np.conj(felt) if mirrored else np.asarray(felt)
        x = x - x.mean()
        norm = float(np.linalg.norm(x) * np.linalg.norm(target))
        product = complex(np.vdot(x, target)) / max(norm, 1e-300)
        fits.append((abs(product), cmath.phase(product), mirrored))
    (fit, turned, mirrored), (other, *_) = sorted(fits, reverse=True)
    yaw = planned + 0.5 * math.pi * round((turned - planned) / (0.5 * math.pi))
    if fit < FITS or fit - other < MIRRORED_FITS_LESS or abs(turned - yaw) > SNAP:
        return None
    yaw = -((math.pi - yaw) % math.tau - math.pi)  # in (-pi, pi]
    return (yaw if abs(yaw) > 1e-12 else 0.0), mirrored


Floats = npt.NDArray[np.float64]

CENTRE = 0.2
"""Part of the smaller side of a board within which its centre is; a corner is not."""
CORNER_SHARE = 0.3
"""Part of the strength that a board has to have when its corner is pressed: a neighbour may be under the
finger too, and more so."""


@dataclass(frozen=True, slots=True)
class Place:
    """A place of the arm file."""

    key: str
    """Of its table, as ``Mounting.key``."""
    label: str
    """Where it is, in words."""
    kind: tuple[int, ...]
    size: tuple[float, float]
    """m"""
    yaw: float
    """As planned, rad."""
    around: str = "larger angle"
    """What lies on the side of growing a."""


@dataclass(frozen=True, slots=True)
class Identified:
    """What was found at a place; ``yaw`` (rad) is as planned where corners were not pressed."""

    node_id: int
    identity: tuple[int, ...]
    yaw: float
    mirrored: bool = False


class Identification(PressDialogue):
    """The dialogue.

    Args:
        places: in the order in which they are asked for.
        boards: those on the bus; the pressures are theirs, in this order.
        turns: whether corners are pressed.
        found: what an earlier dialogue has found, by the key of the place.
    """

    def __init__(
        self,
        places: Sequence[Place],
        boards: Sequence[Board],
        *,
        turns: bool = True,
        found: dict[str, Identified] | None = None,
    ) -> None:
        super().__init__(boards)
        self.places = tuple(places)
        known = {(board.identity, board.node_id) for board in boards}
        keys = {place.key for place in places}
        self.found = {
            key: old
            for key, old in (found or {}).items()
            if key in keys and (old.identity, old.node_id) in known
        }
        """By the key of the place, in the order in which they were found."""
        self._skipped: list[str] = []
        self._turns = turns
        self._board = 0
        self._felt: list[complex] = []
        """Where the board was pressed so far: its centre, and corners."""

    def table(self) -> dict[str, Any]:
        """Return what was found, as tables and numbers."""
        return {key: {**asdict(own), "identity": list(own.identity)} for key, own in self.found.items()}

    def missing(self) -> list[Place]:
        """Return the places at which no board was found."""
        return [place for place in self.places if place.key not in self.found]

    def summary(self) -> list[str]:
        """Return what was found, place by place."""
        lines = []
        for k, place in enumerate(self.places, 1):
            said = "left out" if place.key in self._skipped else "-"
            if own := self.found.get(place.key):
                said = f"node {own.node_id}, yaw {math.degrees(own.yaw):.0f} deg{', mirrored' * own.mirrored}"
            lines.append(f"  {k:3}  {place.label}: {said}")
        return lines

    def greet(self) -> list[str]:
        """Return what is said first."""
        known = [f"{len(self.found)} of {len(self.places)} places are known from before."] * bool(self.found)
        return [*known, f"Press with a finger for a second, let go, and wait for the next line. {HELP}."]

    @property
    def _next(self) -> Place | None:
        """The place that is asked for."""
        return next((place for place in self.missing() if place.key not in self._skipped), None)

    def ask(self) -> str:
        """Return what is asked for: the centre of a place, or one of its corners."""
        place = self._next
        self.is_complete = place is None
        if place is None:
            return "All places have been asked for. Type done to write the arm file, undo, or list."
        what = f"corner {_words_of_corner(place, len(self._felt) - 1)}" if self._felt else "centre"
        return f"[{self.places.index(place) + 1}/{len(self.places)}] {place.label}: press the {what}."

    def skip(self) -> list[str]:
        """Leave out the place that is asked for."""
        self._felt = []
        if place := self._next:
            self._skipped.append(place.key)
        return [f"Left out: {place.label}."] if place else []

    def undo(self) -> list[str]:
        """Take back the last press, or all that was left out."""
        if self._felt:
            self._felt = []
            return ["This place begins anew."]
        if self.found:
            key, _ = self.found.popitem()
            return [f"Taken back: {place.label}." for place in self.places if place.key == key]
        said = [] if self._skipped else ["There is nothing to take back."]
        self._skipped.clear()
        return said

    def take(self, press: HandPress) -> str:
        """Take a press: the next point of the place, or with the last one the board that sits there."""
        place = self._next
        assert place is not None
        if fault := self._wrong_corner(press, place) if self._felt else self._wrong_centre(press, place):
            return fault
        self._board = self._board if self._felt else press.board
        board = self.boards[self._board]
        self._felt.append(complex(press.places[self._board]))
        shows_turn, said = self._turns and _shows_turn(board.uv), f"node {board.node_id}"
        if shows_turn and len(self._felt) <= len(CORNERS):
            return said if len(self._felt) == 1 else ""
        felt, self._felt = self._felt, []
        yaw, mirrored = place.yaw, False
        if shows_turn:
            points = [0j, *(corner(place.size, place.yaw, k) for k in range(len(CORNERS)))]
            turn = fit_turn(felt, points, place.yaw)
            if turn is None:
                return (
                    "That was not the centre and those two corners of a board, as the arm file has it or by "
                    "quarters of a turn from that; begin with its centre."
                )
            yaw, mirrored = turn
            degrees = math.degrees(math.remainder(yaw - place.yaw, math.tau))
            said += f", turned by {degrees:.0f} deg" if abs(degrees) > 0.5 else ", as planned"
            said += ", mirrored" * mirrored
        elif self._turns:
            said += "; too few tactels to show how it is turned"
        self.found[place.key] = Identified(board.node_id, board.identity, yaw, mirrored)
        return f"{place.label}: {said}"

    def _wrong_corner(self, press: HandPress, place: Place) -> str:
        """Return what is wrong with a press that was to be at a corner of the board."""
        asked, away = self.boards[self._board].node_id, np.abs(press.places[self._board] - self._felt)
        is_near = away < CENTRE * min(place.size)
        if press.strengths[self._board] < CORNER_SHARE:
            return f"Node {self.boards[press.board].node_id} was pressed in place of node {asked}."
        if is_near[0]:
            return f"Node {asked} was pressed near its centre, not at a corner."
        if is_near.any():
            return f"Node {asked} was pressed at the corner before: press the other one."
        return ""

    def _wrong_centre(self, press: HandPress, place: Place) -> str:
        """Return what is wrong with a press that was to be at the centre of a board."""
        board, off = self.boards[press.board], abs(press.places[press.board])
        if press.others:
            nodes = ", ".join(str(self.boards[b].node_id) for b in (press.board, *press.others))
            return f"More than one board was pressed (nodes {nodes}): press one, away from its edges."
        for other in self.places:
            if other.key in self.found and self.found[other.key].node_id == board.node_id:
                return f"Node {board.node_id} was pressed, which is at {other.label}; if not, type undo."
        if board.kind != place.kind:
            return f"Node {board.node_id} is another kind of board than the arm file has at {place.label}."
        if off > CENTRE * min(place.size):
            return f"Node {board.node_id} was pressed {1e3 * off:.0f} mm from its centre."
        return ""


def _words_of_corner(place: Place, which: int) -> str:
    """Return where a corner of a place is, in words."""
    c = corner(place.size, place.yaw, which)
    along = f"at the {'far' if c.real > 0 else 'near'} end of the link"
    around = f"on the side of {place.around if c.imag > 0 else place.around.replace('larger', 'smaller')}"
    if abs(c.real) < 0.3 * abs(c):
        return around
    return along if abs(c.imag) < 0.3 * abs(c) else f"{along}, {around}"


def _shows_turn(uv: Floats) -> bool:
    """Whether the tactels of a board are spread in two directions."""
    spread = np.linalg.svd(uv - uv.mean(axis=0), compute_uv=False)
    return bool(len(uv) > 2 and spread[-1] > 1e-3)
