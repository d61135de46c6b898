"""The dialogue that finds which board sits at which place: pressures and answers in, lines to show out.

A person presses each place: its centre, then two of its corners. The board that is pressed belongs there, and
the corners show how it is turned and whether it is mirrored. A press that does not fit what was asked for is
named and asked for again; nothing is guessed.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
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

    def summary(self) -> Iterator[str]:
        """Return what was found, place by place."""
        for k, place in enumerate(self.places, 1):
            said = "left out" if place.key in self._skipped else "-"
            if own := self.found.get(place.key):
                said = f"node {own.node_id}, yaw {math.degrees(own.yaw):.0f} deg{', mirrored' * own.mirrored}"
            yield f"  {k:3}  {place.label}: {said}"

    def _open(self) -> Iterator[str]:
        if self.found:
            yield f"{len(self.found)} of {len(self.places)} places are known from before."
        yield f"Press with a finger for a second, let go, and wait for the next line. {HELP}."
        yield from self._ask()

    def _left(self) -> list[Place]:
        return [place for place in self.missing() if place.key not in self._skipped]

    def _ask(self) -> Iterator[str]:
        left = self._left()
        self.is_complete = not left
        if not left:
            yield "All places have been asked for. Type done to write the arm file, undo, or list."
            return
        where = f"[{self.places.index(left[0]) + 1}/{len(self.places)}] {left[0].label}"
        what = f"corner {self._corner_words(left[0])}" if self._felt else "centre"
        yield f"{where}: press the {what}."

    def _corner_words(self, place: Place) -> str:
        c = corner(place.size, place.yaw, len(self._felt) - 1)
        along = "far" if c.real > 0 else "near"
        around = place.around if c.imag > 0 else place.around.replace("larger", "smaller")
        if abs(c.real) < 0.3 * abs(c):
            return f"on the side of {around}"
        if abs(c.imag) < 0.3 * abs(c):
            return f"at the {along} end of the link"
        return f"at the {along} end of the link, on the side of {around}"

    def _skip(self) -> Iterator[str]:
        for place in self._left()[:1]:
            self._skipped.append(place.key)
            yield f"Left out: {place.label}."
        self._felt = []
        yield from self._ask()

    def _undo(self) -> Iterator[str]:
        if self._felt:
            self._felt = []
            yield "This place begins anew."
        elif self.found:
            key, _ = self.found.popitem()
            yield f"Taken back: {next(place.label for place in self.places if place.key == key)}."
        elif not self._skipped:
            yield "There is nothing to take back."
        else:
            self._skipped.clear()
        yield from self._ask()

    def _take(self, press: HandPress) -> Iterator[str]:
        """Take a press, and ask for the next point of the place or note the board that sits there."""
        if not self._felt:
            self._board = press.board
        board, place = self.boards[self._board], self._left()[0]
        self._felt.append(press.places[self._board])
        shows_turn = self._turns and _shows_turn(board.uv)
        said, yaw, mirrored = f"node {board.node_id}", place.yaw, False
        if shows_turn and len(self._felt) <= len(CORNERS):
            if len(self._felt) == 1:
                yield said
            yield from self._ask()
            return
        felt, self._felt = self._felt, []
        if shows_turn:
            points = [0j, *(corner(place.size, place.yaw, k) for k in range(len(CORNERS)))]
            turn = fit_turn(felt, points, place.yaw)
            if turn is None:
                yield (
                    "That was not the centre and those two corners of a board, as the arm file has it or by "
                    "quarters of a turn from that; begin with its centre."
                )
                yield from self._ask()
                return
            yaw, mirrored = turn
            degrees = math.degrees(math.remainder(yaw - place.yaw, math.tau))
            said += f", turned by {degrees:.0f} deg" if abs(degrees) > 0.5 else ", as planned"
            said += ", mirrored" * mirrored
        elif self._turns:
            said += "; too few tactels to show how it is turned"
        self.found[place.key] = Identified(board.node_id, board.identity, yaw, mirrored)
        yield f"{place.label}: {said}"
        yield from self._ask()

    def _wrong(self, press: HandPress) -> str:
        place, board = self._left()[0], self.boards[press.board]
        node_id, near = board.node_id, CENTRE * min(place.size)
        if self._felt:
            asked, at = self.boards[self._board].node_id, press.places[self._board]
            if press.strengths[self._board] < CORNER_SHARE:
                return f"Node {node_id} was pressed in place of node {asked}."
            if abs(at - self._felt[0]) < near:
                return f"Node {asked} was pressed near its centre, not at a corner."
            if any(abs(at - old) < near for old in self._felt[1:]):
                return f"Node {asked} was pressed at the corner before: press the other one."
            return ""
        if press.others:
            nodes = ", ".join(str(self.boards[b].node_id) for b in (press.board, *press.others))
            return f"More than one board was pressed (nodes {nodes}): press one, away from its edges."
        for other in self.places:
            if other.key in self.found and self.found[other.key].node_id == node_id:
                return f"Node {node_id} was pressed, which is at {other.label}; if not, type undo."
        if board.kind != place.kind:
            return f"Node {node_id} is another kind of board than the arm file has at {place.label}."
        if abs(press.place) > near:
            return f"Node {node_id} was pressed {1e3 * abs(press.place):.0f} mm from its centre."
        return ""


def _shows_turn(uv: Floats) -> bool:
    """Whether the tactels of a board are spread in two directions."""
    spread = np.linalg.svd(uv - uv.mean(axis=0), compute_uv=False)
    return bool(len(uv) > 2 and spread[-1] > 1e-3)
