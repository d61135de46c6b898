"""The dialogue that guides through the presses of a calibration: pressures and answers in, lines to show out.

Each line asks for a place: the one on a board that is farthest from those pressed. A press on another board,
elsewhere on it, too light or too short is named and asked for again. It ends when every board has its
presses; begun again with them it asks for another round.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats
from skinbus.estimate.calibration import gate
from skinbus.estimate.calibration.table import Press, centroid
from skinbus.estimate.calibration.validation import next_place
from skinbus.master.commissioning.press_dialogue import Board, HandPress, PressDialogue
from skinbus.model import Arm

ROUND = 20
"""Presses on a board in a round, or one for each tactel if there are more."""
STRAY = 0.8
"""Pitches between place and readings from which a press is asked for again: a centroid errs by 0.25."""


class PressGuide(PressDialogue):
    """The dialogue.

    Args:
        arm: the boards to press, where the arm file has them; the pressures are theirs, in this order.
        force: of all presses, N; NaN where it is not known, but the same in all.
        presses: those made before.
    """

    def __init__(self, arm: Arm, force: float = math.nan, presses: Sequence[Press] = ()) -> None:
        super().__init__(
            [
                Board(placed.node_id, (), np.asarray(placed.patch.tactels_uv), placed.patch.threshold)
                for placed in arm.patches
            ]
        )
        self.arm = arm
        self.presses = list(presses)
        self._force = force
        self._left_out: list[tuple[int, Floats]] = []
        self._patch, self._uv = 0, np.zeros(2)
        sizes = [placed.patch.n_tactels for placed in arm.patches]
        self._goal = np.maximum(np.maximum(sizes, ROUND), -(-gate.FEWEST // arm.n_patches))
        if (self._counts() >= self._goal).all():
            self._goal = self._counts() + ROUND

    def _counts(self) -> npt.NDArray[np.intp]:
        return np.bincount([press.patch for press in self.presses], minlength=self.arm.n_patches)

    def _pressed(self, p: int) -> Floats:
        """Return the places on a board that are done with, (n, 2) m."""
        own = [press for press in self.presses if press.patch == p]
        at = self.arm.on_board(p, np.array([x.s for x in own]), np.array([x.a for x in own]))
        out = [uv for q, uv in self._left_out if q == p]
        return np.concatenate([at, np.reshape(out, (-1, 2))])

    def ask(self) -> str:
        """Return the place that is asked for next; a board is finished before another one begins."""
        left = np.flatnonzero(self._counts() < self._goal)
        self.is_over = not len(left)
        if self.is_over:
            return f"{len(self.presses)} presses: that is enough."
        self._patch = self._patch if self._patch in left else int(left[0])
        self._uv = next_place(self.arm.patches[self._patch].patch, self._pressed(self._patch))
        (u, v), (s, a) = 1e3 * self._uv, self._place()
        n_planned = np.maximum(self._goal, self._counts()).sum()
        return (
            f"[{len(self.presses) + 1}/{n_planned}] node {self.boards[self._patch].node_id}: press at "
            f"s {1e3 * s:.1f} mm, a {1e3 * a:.1f} mm (on the board u {u:+.1f} mm, v {v:+.1f} mm)."
        )

    def _place(self) -> tuple[float, float]:
        """Return the place that is asked for, on the chart, m."""
        s, a = self.arm.on_link(self._patch, self._uv[None])
        surface = self.arm.links[self.arm.patches[self._patch].link].surface
        return float(s[0]), float(surface.wrap(a[0]))

    def undo(self) -> str:
        """Take back the last press."""
        if not self.presses:
            return "There is nothing to take back."
        last = self.presses.pop()
        self._patch = last.patch
        return f"Taken back: node {self.arm.node_id[last.patch]}, s {1e3 * last.s:.1f} mm."

    def skip(self) -> str:
        """Leave out the place that is asked for."""
        self._left_out.append((self._patch, self._uv))
        return ""

    def take(self, press: HandPress) -> str:
        """Take a press as one at the place that is asked for, or return what is wrong with it."""
        node_id, asked = self.boards[press.board].node_id, self.boards[self._patch].node_id
        if press.board != self._patch:
            return f"Node {node_id} was pressed in place of node {asked}."
        (s, a), here = self._place(), self.arm.tactels_of(self._patch)
        made = Press(self._patch, s, a, self._force, press.readings[here], noise=press.noise[here])
        patch = self.arm.patches[self._patch].patch
        uv = np.asarray(patch.tactels_uv)
        read = centroid(uv, made.readings)
        off = float(np.hypot(*(np.clip(self._uv, uv.min(axis=0), uv.max(axis=0)) - read)))
        if off > STRAY * patch.pitch:
            (s,), (a,) = self.arm.on_link(self._patch, read[None])
            near = f"near s {1e3 * s:.0f} mm, a {1e3 * a:.0f} mm"
            return f"Node {node_id} was pressed {1e3 * off:.0f} mm from there, {near}."
        self.presses.append(made)
        return ""
