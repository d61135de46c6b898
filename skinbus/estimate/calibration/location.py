"""Where boards sit, from presses at known places: place and yaw of each on its surface, with a covariance.

Each press is a contact (u, v) on the board, by the board's own law, and a point (s, a) on the link. On the
surface unrolled about the place of the board in the arm file the two differ by a rotation and a shift::

    minimise  sum_k rho(|L_k ((x_k, y_k) - c - R(yaw) (u_k, v_k))|) + prior,    L_k L_k^T = (sigma^2 + C_k)^-1

C_k is the covariance of the contact, sigma that of the places, which all boards together refine. The start is
the best of the poses by which one press fits exactly, turned as in the arm file, or two, so that outliers
have no part in it; then Gauss-Newton with Tukey's weights; then least squares without the outliers. A wide
prior about the arm file keeps what presses do not determine where the file has it, and its variance says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.estimator import Estimator
from skinbus.model import Arm, Link, PlacedPatch, Radial, Surface

Floats = npt.NDArray[np.float64]

PLACE_SD: Final = 0.3e-3
"""m; a robot's tool, or a probe in a jig."""
PRIOR_SD: Final = (10e-3, 10e-3, math.radians(10.0))
"""m, m, rad: more than anybody misplaces a board without seeing it; a tenth of that, presses determine."""
KNOWN: Final = 0.3
"""Part of the prior's standard deviation above which presses have not determined a direction."""
OUTLIER: Final = 4.0
"""Standard deviations of a press from which it is an outlier: 3 of 10 000 good ones."""
TUKEY: Final = 4.685
"""Standard deviations at which Tukey's weight is 0: 95 % efficient for normal errors."""
PRIOR_FREEDOM: Final = 10.0
"""Weight of the place's standard deviation as said, in degrees of freedom, when the presses refine it."""
WIDE: Final = 3.0
"""Standard deviations as said with which the search begins: places may be worse than said."""
MOST_PAIRS, APART_M = 300, 5e-3
"""Pairs of presses that give a start, and how far they are apart at least: else they give no direction."""
TURNED: Final = math.radians(30.0)
"""A yaw this far from that of the arm file is no error of mounting but another way to mount."""
SECOND: Final = 0.3
"""Part of the force of the strongest contact from which a second one makes a press unusable."""
STEPS: Final = 20
"""Of Gauss-Newton, with either weights; it converges in five."""
ROUNDS: Final = 3
"""Of refining sigma; it changes by less than a hundredth in the third."""


@dataclass(frozen=True, slots=True)
class PlacedPress:
    """What a board reads under one press at a known place."""

    patch: int
    s: float
    a: float
    """m"""
    readings: Floats
    """(n_tactels of the patch,) Pa"""


@dataclass(frozen=True, slots=True)
class Located:
    """Where one board sits."""

    patch: int
    s: float
    a: float
    yaw: float
    """m, m, rad"""
    covariance: Floats
    """(3, 3) of the shift along s, that across (m) and the yaw (rad)."""
    used: tuple[int, ...]
    """Numbers of the presses it comes from."""
    outliers: tuple[int, ...]
    unusable: tuple[int, ...]
    """Presses with no contact on the board, or with more than one."""
    shift: tuple[float, float, float]
    """From the arm file: along s, across (m), yaw (rad)."""
    is_turned: bool = False
    """Whether it is turned by more than errors of mounting: the file is to say so first."""
    is_mirrored: bool = False
    """Whether presses fit the mirrored board, and not this one."""
    unknown: tuple[str, ...] = ()
    """What presses do not determine: "s", "a", "yaw"."""


@dataclass(frozen=True, slots=True)
class Location:
    """The boards that were pressed."""

    boards: list[Located]
    place_sd: float
    """m, of the places of the presses along each direction, as refined."""


class _Board:
    """A board with its presses as contacts; poses are (x, y, yaw) from that of the arm file."""

    def __init__(self, arm: Arm, p: int, presses: Sequence[PlacedPress]) -> None:
        self.patch, self.placed = p, arm.patches[p]
        self.surface = arm.links[self.placed.link].surface
        own = [k for k, press in enumerate(presses) if press.patch == p]
        contacts = _contacts(self.placed, [presses[k].readings for k in own])
        self.press = [k for k, contact in zip(own, contacts, strict=True) if contact is not None]
        self.unusable = tuple(sorted({*own} - {*self.press}))
        found = [contact for contact in contacts if contact is not None]
        turn = complex(math.cos(self.placed.yaw), math.sin(self.placed.yaw))
        self.felt = np.array([at for at, _ in found], np.complex128) * turn  # on the chart, from the centre
        rotation = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
        self.cov = rotation @ np.array([c for _, c in found]).reshape(-1, 2, 2) @ rotation.T
        s, a = (np.array([getattr(presses[k], name) for k in self.press]) for name in ("s", "a"))
        x, y = self.surface.develop(s, a, self.placed.a)
        self.said = np.asarray(x - self.placed.s + 1j * y)
        self.kept = np.ones(len(self.press), np.bool_)
        self.pose, self.covariance, self.square = np.zeros(3), np.diag(np.square(PRIOR_SD)), 0.0

    def _residuals(self, pose: Floats, sigma: float) -> tuple[Floats, Floats, Floats]:
        """Return whitened residuals (n, 2), their Jacobian (n, 2, 3), and their lengths (n,)."""
        turn = complex(math.cos(pose[2]), math.sin(pose[2]))
        felt = turn * self.felt
        off = self.said - complex(pose[0], pose[1]) - felt
        jacobian = np.zeros((len(off), 2, 3))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = -1.0
        jacobian[:, 0, 2], jacobian[:, 1, 2] = felt.imag, -felt.real
        rotation = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
        white = np.linalg.inv(np.linalg.cholesky(sigma**2 * np.eye(2) + rotation @ self.cov @ rotation.T))
        left = np.einsum("kij,kj->ki", white, np.stack([off.real, off.imag], -1))
        return left, white @ jacobian, np.linalg.norm(left, axis=-1)

    def score(self, pose: Floats, sigma: float) -> float:
        """Return the sum of squares of the residuals, those of outliers cut."""
        return float(np.minimum(self._residuals(pose, sigma)[2] ** 2, OUTLIER**2).sum())

    def start(self, sigma: float) -> float:
        """Take the best pose by which one or two presses fit, or that of the arm file; return its score."""
        centres = [0.0, *(self.said - self.felt)]
        poses = [np.array([z.real, z.imag, 0.0]) for z in map(complex, centres)]
        pairs = list(combinations(range(len(self.press)), 2))
        for i, j in pairs[:: max(1, math.ceil(len(pairs) / MOST_PAIRS))]:
            said, felt = self.said[j] - self.said[i], self.felt[j] - self.felt[i]
            if min(abs(said), abs(felt)) >= APART_M:
                turn = said * felt.conjugate() / abs(said * felt)
                z = 0.5 * (self.said[i] + self.said[j] - turn * (self.felt[i] + self.felt[j]))
                poses.append(np.array([z.real, z.imag, np.angle(turn)]))
        scores = [self.score(pose, sigma) for pose in poses]
        self.pose = poses[int(np.argmin(scores))]
        return min(scores)

    def fit(self, sigma: float) -> None:
        """Take the pose of least squares, its covariance, and what the presses leave that are no outliers."""
        # the prior is about the file; where another way to mount fits, about that, which is reported
        centre = self.pose * [0.0, 0.0, abs(self.pose[2]) > TURNED]
        prior = np.power(PRIOR_SD, -2.0)
        for is_robust in (True, False):
            for _ in range(STEPS):
                left, jacobian, length = self._residuals(self.pose, sigma)
                self.kept = length < OUTLIER
                weight = np.maximum(1.0 - (length / TUKEY) ** 2, 0.0) ** 2 if is_robust else 1.0 * self.kept
                weighted = weight[:, None, None] * jacobian
                normal = np.einsum("kij,kil->jl", weighted, jacobian) + np.diag(prior)
                pull = np.einsum("kij,ki->j", weighted, left) + prior * (self.pose - centre)
                self.pose = self.pose - np.linalg.solve(normal, pull)
        self.covariance = np.linalg.inv(normal)
        length = self._residuals(self.pose, sigma)[2]
        self.square = float((length[self.kept] ** 2).sum())

    def located(self, sigma: float) -> Located:
        """Return where the board sits."""
        x, y, turn = self.pose.tolist()
        turn = math.remainder(turn, math.tau)
        s, a = self.surface.undevelop(self.placed.s + x, y, self.placed.a)
        # on a cone the direction of s at the new place is turned
        slant = self.surface.taper * float(self.surface.wrap(a - self.placed.a)) / self.surface.radius
        usual, n = self.score(self.pose, sigma), len(self.press)
        self.felt, self.cov = self.felt.conjugate(), self.cov * [[1.0, -1.0], [-1.0, 1.0]]
        is_mirrored = n > 2 and usual > 0.3 * n * OUTLIER**2 and self.start(sigma) < 0.3 * usual
        spread, press = np.sqrt(np.diag(self.covariance)), np.array(self.press, int)
        return Located(
            self.patch,
            float(s),
            float(a),
            math.remainder(self.placed.yaw + turn - slant, math.tau),
            self.covariance,
            tuple(press[self.kept].tolist()),
            tuple(press[~self.kept].tolist()),
            self.unusable,
            (x, y, turn),
            is_turned=abs(turn) > TURNED and not is_mirrored,
            is_mirrored=is_mirrored,
            unknown=tuple(np.array(["s", "a", "yaw"])[spread > KNOWN * np.array(PRIOR_SD)].tolist()),
        )


def locate(arm: Arm, presses: Sequence[PlacedPress], *, place_sd: float = PLACE_SD) -> Location:
    """Return where the pressed boards of an arm sit.

    place_sd: standard deviation of the places of the presses along each direction, m; residuals refine it
    """
    boards = [_Board(arm, p, presses) for p in sorted({press.patch for press in presses})]
    sigma = WIDE * place_sd
    for board in boards:
        board.start(sigma)
        board.fit(sigma)
    for _ in range(ROUNDS):
        freedom = sum(max(2 * int(board.kept.sum()) - 3, 0) for board in boards)
        # the contacts' own part of the residuals is small beside that of the places
        said = PRIOR_FREEDOM * (place_sd / sigma) ** 2
        sigma *= math.sqrt((sum(board.square for board in boards) + said) / (freedom + PRIOR_FREEDOM))
        for board in boards:
            board.fit(sigma)
    return Location([board.located(sigma) for board in boards], sigma)


def _contacts(placed: PlacedPatch, readings: Sequence[Floats]) -> list[tuple[complex, Floats] | None]:
    """Return place (u + iv) and covariance of the contact on a board alone; None without one, or with two."""
    patch, size = placed.patch, 4.0 * max(placed.patch.size)
    if isinstance(patch.law, Radial) and patch.law.misfit_profile is None:
        # one tool makes all the presses: with a size for each, places near the rim scatter more
        law = replace(patch.law, misfit_profile=patch.law.misfit * np.abs(patch.law.table))
        patch = replace(patch, law=law)
    flat = replace(placed, patch=patch, link=0, s=0.5 * size, a=0.0, yaw=0.0, bus=0)
    estimator = Estimator(Arm("board", [Link("board", Surface.plane(size, size))], [flat]), level="fit")
    found: list[tuple[complex, Floats] | None] = []
    for row in readings:
        contacts = estimator.update(row, 0)
        order = np.argsort(-contacts.force)
        rivals = contacts.force[order] > SECOND * contacts.force.max(initial=0.0)
        if rivals.sum() != 1 or not np.isfinite(contacts.covariance[order[0], :2, :2]).all():
            found.append(None)
            continue
        best = order[0]
        place = complex(contacts.s[best] - 0.5 * size, contacts.a[best])
        found.append((place, contacts.covariance[best, :2, :2]))
    return found
