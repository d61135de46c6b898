"""Where boards sit, from presses at known places: place and yaw of each on its surface, with a covariance.

Each press is a contact (u, v) on the board, by the board's own law, and a point (s, a) on the link. On the
surface unrolled about the place of the board in the arm file the two differ by a rotation and a shift::

    minimise  sum_k rho(|(x_k, y_k) - c - R(yaw) (u_k, v_k)| / sd_k) + prior
    sd_k^2 = sigma^2 + sd(u_k, v_k)^2

sigma is that of the places, which all boards together refine. The start is the turn that leaves least about
its median shift; then least squares with the soft L1 loss, and without the outliers. A wide prior about the
arm file keeps what presses do not determine where the file has it, and its variance says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from skinbus.arrays import Floats
from skinbus.estimate.calibration.table import Press
from skinbus.estimate.estimator import Estimator
from skinbus.model import Arm, Link, PlacedPatch, Radial, Surface

Places = npt.NDArray[np.complex128]

PLACE_SD = 0.3e-3
"""m; a robot's tool, or a probe in a jig."""
PRIOR_SD = (10e-3, 10e-3, math.radians(10.0))
"""m, m, rad: more than anybody misplaces a board without seeing it; a tenth of that, presses determine."""
KNOWN = 0.3
"""Part of the prior's standard deviation above which presses have not determined a direction."""
OUTLIER = 4.0
"""Standard deviations of a press from which it is an outlier: 3 of 10 000 good ones."""
PRIOR_FREEDOM = 10.0
"""Weight of the place's standard deviation as said, in degrees of freedom, when the presses refine it."""
WIDE, ROUNDS = 3.0, 4
"""Standard deviations as said with which the search begins, as places may be worse than said; and rounds of
refining them: they change by less than a hundredth in the last."""
TURNS = np.radians(15.0) * np.arange(-11, 13)
"""rad, from which a turn is looked for."""
TURNED = math.radians(30.0)
"""A yaw this far from that of the arm file is no error of mounting but another way to mount."""
SECOND = 0.3
"""Part of the force of the strongest contact from which a second one makes a press unusable."""


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


class Pose(NamedTuple):
    """A shift (m, m) and a turn (rad) by which places fit others."""

    values: Floats
    covariance: Floats
    length: Floats
    """(n,) standard deviations that they leave."""

    @property
    def score(self) -> float:
        """Sum of their squares, those of outliers cut."""
        return float(np.minimum(self.length**2, OUTLIER**2).sum())


def fit_pose(felt: Places, said: Places, sd: Floats) -> Pose:
    """Return the pose by which places ``felt`` are those ``said``, x + iy (n,) m, but for sd (n,) m."""
    pose = np.zeros(3)
    if len(felt):
        off = said - np.exp(1j * TURNS)[:, None] * felt
        shift = np.median(off.real, axis=1) + 1j * np.median(off.imag, axis=1)
        score = np.minimum((np.abs(off - shift[:, None]) / sd) ** 2, OUTLIER**2).sum(axis=1)
        # of turns that fit alike, as when all presses are at one place, the smaller one
        best = int((score + np.minimum((TURNS / PRIOR_SD[2]) ** 2, OUTLIER**2)).argmin())
        pose[:] = shift[best].real, shift[best].imag, TURNS[best]
    # the prior is about the file; where another way to mount fits, about that, which is reported
    centre, kept = pose * [0.0, 0.0, abs(pose[2]) > TURNED], np.ones(len(felt), np.bool_)

    def left(pose: Floats) -> Places:
        return np.asarray((said - complex(pose[0], pose[1]) - np.exp(1j * pose[2]) * felt) / sd)

    def residuals(pose: Floats) -> Floats:
        off = left(pose)[kept]
        return np.concatenate([off.real, off.imag, (pose - centre) / PRIOR_SD])

    for loss in ("soft_l1", "linear"):
        found = least_squares(residuals, pose, loss=loss, x_scale=PRIOR_SD)
        pose, kept = found.x, np.abs(left(found.x)) < OUTLIER
    pose[2] = math.remainder(pose[2], math.tau)
    jacobian: Any = found.jac
    return Pose(pose, np.linalg.inv(jacobian.T @ jacobian), np.abs(left(pose)))


class _Seen(NamedTuple):
    """What a board sees of its presses."""

    patch: int
    press: npt.NDArray[np.intp]
    """Numbers of those with one contact; of the others:"""
    unusable: tuple[int, ...]
    felt: Places
    said: Places
    """(n,) m, from the place of the board in the arm file, along s and across."""
    sd: Floats

    def pose(self, sigma: float, *, mirrored: bool = False) -> Pose:
        """Return the pose of the board, or of the mirrored one."""
        felt = self.felt.conjugate() if mirrored else self.felt
        return fit_pose(felt, self.said, np.hypot(sigma, self.sd))


def locate(arm: Arm, presses: Sequence[Press], *, place_sd: float = PLACE_SD) -> Location:
    """Return where the pressed boards of an arm sit.

    place_sd: standard deviation of the places of the presses along each direction, m; residuals refine it
    """
    boards = [_seen(arm, p, presses) for p in sorted({press.patch for press in presses})]
    sigma = WIDE * place_sd
    for _ in range(ROUNDS):
        near = np.concatenate([board.pose(sigma).length for board in boards])
        near = near[near < OUTLIER]
        freedom = max(2 * len(near) - 3 * len(boards), 0)
        # the contacts' own part of the residuals is small beside that of the places
        said = PRIOR_FREEDOM * (place_sd / sigma) ** 2
        sigma *= math.sqrt((float(near @ near) + said) / (freedom + PRIOR_FREEDOM))
    return Location([_located(arm.patches[board.patch], arm, board, sigma) for board in boards], sigma)


def _seen(arm: Arm, p: int, presses: Sequence[Press]) -> _Seen:
    """Return what a board sees, by a contact of its own law on the board alone."""
    own, placed = np.array([k for k, press in enumerate(presses) if press.patch == p]), arm.patches[p]
    patch, size = placed.patch, 4.0 * max(placed.patch.size)
    if isinstance(patch.law, Radial) and patch.law.misfit_profile is None:
        # one tool makes all the presses: with a size for each, places near the rim scatter more
        law = replace(patch.law, misfit_profile=patch.law.misfit * np.abs(patch.law.table))
        patch = replace(patch, law=law)
    alone = replace(placed, patch=patch, link=0, s=0.5 * size, a=0.0, bus=0)
    board = Arm("board", [Link("board", Surface.plane(size, size))], [alone])
    s, a, _, sd, second = strongest(board, np.array([presses[k].readings for k in own])).T
    usable = np.isfinite(s) & (second <= SECOND)
    felt = s - 0.5 * size + 1j * a
    along, across = np.array([(presses[k].s, presses[k].a) for k in own]).T
    said = arm.on_board(p, along, across) @ (1.0, 1j) * np.exp(1j * placed.yaw)
    return _Seen(p, own[usable], tuple(own[~usable].tolist()), felt[usable], said[usable], sd[usable])


def _located(placed: PlacedPatch, arm: Arm, board: _Seen, sigma: float) -> Located:
    found, n, surface = board.pose(sigma), len(board.press), arm.links[placed.link].surface
    x, y, turn = found.values.tolist()
    s, a = surface.undevelop(placed.s + x, y, placed.a)
    # on a cone the direction of s at the new place is turned
    slant = surface.taper * float(surface.wrap(a - placed.a)) / surface.radius
    misfits = n > 2 and found.score > 0.3 * n * OUTLIER**2
    is_mirrored = misfits and board.pose(sigma, mirrored=True).score < 0.3 * found.score
    spread, kept = np.sqrt(np.diag(found.covariance)), found.length < OUTLIER
    return Located(
        board.patch,
        float(s),
        float(a),
        math.remainder(placed.yaw + turn - slant, math.tau),
        found.covariance,
        tuple(board.press[kept].tolist()),
        tuple(board.press[~kept].tolist()),
        board.unusable,
        (x, y, turn),
        is_turned=abs(turn) > TURNED and not is_mirrored,
        is_mirrored=is_mirrored,
        unknown=tuple(np.array(["s", "a", "yaw"])[spread > KNOWN * np.array(PRIOR_SD)].tolist()),
    )


def strongest(arm: Arm, readings: Floats) -> Floats:
    """Return the strongest contact of each row of readings (n, n_tactels) Pa; NaN where there is none.

    Its s, a (m), force (N), the standard deviation of its place along each direction (m), and the force of
    the second contact as a part of its own: (n, 5).
    """
    estimator, out = Estimator(arm, "fit"), np.full((len(readings), 5), np.nan)
    for k, row in enumerate(readings):
        found = estimator.update(row, k)
        if len(found):
            forces, best = np.sort(found.force)[::-1], int(found.force.argmax())
            sd = math.sqrt(0.5 * np.trace(found.covariance[best, :2, :2]))
            out[k] = found.s[best], found.a[best], forces[0], sd, forces[1:2].sum() / forces[0]
    return out
