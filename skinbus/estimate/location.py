"""Where boards sit, from presses at known places: place and yaw of each on its surface, with a covariance.

Each press is a contact (u, v) on the board, by the board's own law, and a point (s, a) on the link. On the
surface developed about the board the two differ by a rotation and a shift::

    minimise  sum_k rho(|L_k ((x_k, y_k) - c - R(yaw) (u_k, v_k))|) + prior,    L_k L_k^T = (sigma^2 + C_k)^-1

C_k is the covariance of the contact, sigma that of the places, which all boards together refine. The start is
the best of the poses by which one press fits exactly, turned as in the arm file, or two, so that outliers
have no part in it; then Gauss-Newton with Tukey's weights; then least squares without the outliers. A wide
prior about the arm file keeps what presses do not determine where the file has it, and its variance says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.estimator import Estimator
from skinbus.model import Arm, Law, Link, PlacedPatch, Radial, Surface

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
MOST_PAIRS: Final = 300
TURNED: Final = math.radians(30.0)
"""A yaw this far from that of the arm file is no error of mounting but another way to mount."""
SECOND: Final = 0.3
"""Part of the force of the strongest contact from which a second one makes a press unusable."""
STEPS: Final = 20
CONVERGED: Final = 1e-7
"""m and rad: a thousandth of what presses determine."""
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


@dataclass(slots=True)
class _Board:
    """A board with its presses as contacts."""

    placed: PlacedPatch
    surface: Surface
    press: list[int]
    s: Floats
    a: Floats
    uv: Floats
    """(n, 2) m"""
    cov: Floats
    """(n, 2, 2) m^2, of the contacts"""
    unusable: tuple[int, ...]
    kept: npt.NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.kept = np.ones(len(self.press), np.bool_)


_Pose = tuple[float, float, float]
"""s, a, yaw"""


def locate(arm: Arm, presses: Sequence[PlacedPress], *, place_sd: float = PLACE_SD) -> Location:
    """Return where the pressed boards of an arm sit.

    place_sd: standard deviation of the places of the presses along each direction, m; residuals refine it
    """
    boards = [_contacts(arm, p, presses) for p in sorted({press.patch for press in presses})]
    sigma = WIDE * place_sd
    starts = [_start(board, sigma)[1] for board in boards]
    results = [_fit(board, start, sigma) for board, start in zip(boards, starts, strict=True)]
    for _ in range(ROUNDS):
        square = sum(result[2] for result in results)
        freedom = sum(max(2 * int(board.kept.sum()) - 3, 0) for board in boards)
        # the contacts' own part of the residuals is small beside that of the places
        said = PRIOR_FREEDOM * (place_sd / sigma) ** 2
        sigma *= math.sqrt((square + said) / (freedom + PRIOR_FREEDOM))
        results = [_fit(board, pose, sigma) for board, (pose, *_) in zip(boards, results, strict=True)]
    found = []
    for p, board, (pose, covariance, _) in zip(
        sorted({press.patch for press in presses}), boards, results, strict=True
    ):
        found.append(_located(p, board, pose, covariance, sigma))
    return Location(found, sigma)


def _of_one_size(law: Law) -> Law:
    """Return a law by which contacts have no size of their own: one tool makes all the presses.

    With a size for each, places near the rim scatter more: 0.6 degrees of yaw from six presses, not 0.4.
    """
    if isinstance(law, Radial) and law.misfit_profile is None:
        return replace(law, misfit_profile=law.misfit * np.abs(law.table))
    return law


def _contacts(arm: Arm, p: int, presses: Sequence[PlacedPress]) -> _Board:
    """Return the contacts on one board, found on it alone."""
    placed = arm.patches[p]
    size = 4.0 * max(placed.patch.size)
    patch = replace(placed.patch, law=_of_one_size(placed.patch.law))
    flat = replace(placed, patch=patch, link=0, s=0.5 * size, a=0.0, yaw=0.0, bus=0)
    estimator = Estimator(Arm("board", [Link("board", Surface.plane(size, size))], [flat]), level="fit")
    kept, unusable, uv, cov = [], [], [], []
    for k, press in enumerate(presses):
        if press.patch != p:
            continue
        contacts = estimator.update(press.readings, 0)
        order = np.argsort(contacts.force)[::-1]
        if not len(order) or (
            len(order) > 1 and contacts.force[order[1]] > SECOND * contacts.force[order[0]]
        ):
            unusable.append(k)
            continue
        best = order[0]
        if not np.isfinite(contacts.covariance[best, :2, :2]).all():
            unusable.append(k)
            continue
        kept.append(k)
        uv.append((contacts.s[best] - 0.5 * size, contacts.a[best]))
        cov.append(contacts.covariance[best, :2, :2])
    n = len(kept)
    return _Board(
        placed,
        arm.links[placed.link].surface,
        kept,
        np.array([presses[k].s for k in kept]),
        np.array([presses[k].a for k in kept]),
        np.array(uv).reshape(n, 2),
        np.array(cov).reshape(n, 2, 2),
        tuple(unusable),
    )


def _file_pose(board: _Board) -> _Pose:
    return board.placed.s, board.placed.a, board.placed.yaw


def _residuals(board: _Board, pose: _Pose, sigma: float) -> tuple[Floats, Floats, Floats]:
    """Return whitened residuals (n, 2), their Jacobian (n, 2, 3), and their lengths (n,)."""
    s, a, yaw = pose
    x, y = board.surface.develop(board.s, board.a, a)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, -sin], [sin, cos]])
    felt = board.uv @ turn.T
    left = np.stack([x - s, y], -1) - felt
    jacobian = np.zeros((len(x), 2, 3))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = -1.0
    jacobian[:, 0, 2], jacobian[:, 1, 2] = felt[:, 1], -felt[:, 0]
    white = np.linalg.inv(np.linalg.cholesky(sigma**2 * np.eye(2) + turn @ board.cov @ turn.T))
    left = np.einsum("kij,kj->ki", white, left)
    return left, np.einsum("kij,kjl->kil", white, jacobian), np.linalg.norm(left, axis=-1)


def _move(board: _Board, pose: _Pose, step: Floats) -> _Pose:
    """Return a pose moved by (x, y, yaw) on the surface developed about it."""
    s, a, yaw = pose
    surface = board.surface
    new_s, new_a = surface.undevelop(s + step[0], step[1], a)
    # on a cone the direction of s at the new place is turned
    slant = surface.taper * float(surface.wrap(new_a - a)) / surface.radius
    return float(new_s), float(new_a), math.remainder(yaw + float(step[2]) - slant, math.tau)


def _shift(board: _Board, pose: _Pose) -> Floats:
    """Return how far a pose is from that of the arm file: x, y (m), yaw (rad)."""
    s0, a0, yaw0 = _file_pose(board)
    x, y = board.surface.develop(pose[0], pose[1], a0)
    slant = board.surface.taper * float(board.surface.wrap(pose[1] - a0)) / board.surface.radius
    return np.array([float(x) - s0, float(y), math.remainder(pose[2] + slant - yaw0, math.tau)])


def _press_pose(board: _Board, i: int) -> _Pose:
    """Return the pose by which a press fits, with the yaw of the arm file."""
    s0, a0, yaw0 = _file_pose(board)
    x, y = board.surface.develop(board.s[i], board.a[i], a0)
    centre = complex(float(x), float(y)) - complex(*board.uv[i]) * complex(math.cos(yaw0), math.sin(yaw0))
    return _move(board, (s0, a0, yaw0), np.array([centre.real - s0, centre.imag, 0.0]))


def _pair_pose(board: _Board, i: int, j: int, uv: Floats) -> _Pose | None:
    """Return the pose by which two presses fit, their distance apart."""
    s0, a0, _ = _file_pose(board)
    x, y = board.surface.develop(board.s[[i, j]], board.a[[i, j]], a0)
    z, w = x + 1j * y, uv[[i, j], 0] + 1j * uv[[i, j], 1]
    if abs(w[1] - w[0]) < 5e-3 or abs(z[1] - z[0]) < 5e-3:  # too near each other for a direction
        return None
    yaw = float(np.angle((z[1] - z[0]) / (w[1] - w[0])))
    centre = z.mean() - w.mean() * np.exp(1j * yaw)
    return _move(board, (s0, a0, 0.0), np.array([centre.real - s0, centre.imag, yaw]))


def _score(board: _Board, pose: _Pose, sigma: float) -> float:
    return float(np.minimum(_residuals(board, pose, sigma)[2] ** 2, OUTLIER**2).sum())


def _start(board: _Board, sigma: float) -> tuple[float, _Pose]:
    """Return the best pose by which one or two presses fit, or that of the arm file, after its score."""
    n = len(board.press)
    pairs = list(combinations(range(n), 2))
    pairs = pairs[:: max(1, math.ceil(len(pairs) / MOST_PAIRS))]
    poses = [pose for i, j in pairs if (pose := _pair_pose(board, i, j, board.uv)) is not None]
    poses += [_file_pose(board), *(_press_pose(board, i) for i in range(n))]
    return min((_score(board, pose, sigma), pose) for pose in poses)


def _fit(board: _Board, pose: _Pose, sigma: float) -> tuple[_Pose, Floats, float]:
    """Return the pose, its covariance, and the sum of squares of the presses that are no outliers."""
    aim = _shift(board, pose)
    # the prior is about the file; where another way to mount fits, about that, which is reported
    centre = np.where([False, False, abs(aim[2]) > TURNED], aim, 0.0)
    for is_robust in (True, False):
        for _ in range(STEPS):
            left, jacobian, length = _residuals(board, pose, sigma)
            weight = np.maximum(1.0 - (length / TUKEY) ** 2, 0.0) ** 2
            if not is_robust:
                board.kept = length < OUTLIER
                weight = board.kept.astype(float)
            pull = (_shift(board, pose) - centre) / np.square(PRIOR_SD)
            normal = np.einsum("k,kij,kil->jl", weight, jacobian, jacobian) + np.diag(
                np.power(PRIOR_SD, -2.0)
            )
            right = -np.einsum("k,kij,ki->j", weight, jacobian, left) - pull
            step = np.linalg.solve(normal, right)
            pose = _move(board, pose, step)
            if (np.abs(step) < CONVERGED).all():
                break
    length = _residuals(board, pose, sigma)[2]
    return pose, np.linalg.inv(normal), float((length[board.kept] ** 2).sum())


def _located(p: int, board: _Board, pose: _Pose, covariance: Floats, sigma: float) -> Located:
    shift = _shift(board, pose)
    spread = np.sqrt(np.diag(covariance))
    is_mirrored = _fits_mirrored(board, pose, sigma)
    names = np.array(["s", "a", "yaw"])
    press = np.array(board.press, int)
    return Located(
        p,
        *pose,
        covariance,
        tuple(press[board.kept].tolist()),
        tuple(press[~board.kept].tolist()),
        board.unusable,
        (float(shift[0]), float(shift[1]), float(shift[2])),
        is_turned=bool(abs(shift[2]) > TURNED and not is_mirrored),
        is_mirrored=is_mirrored,
        unknown=tuple(names[spread > KNOWN * np.array(PRIOR_SD)].tolist()),
    )


def _fits_mirrored(board: _Board, pose: _Pose, sigma: float) -> bool:
    """Whether the presses fit the mirrored board, and not this one."""
    mirror = np.array([1.0, -1.0])
    other = replace(board, uv=board.uv * mirror, cov=board.cov * np.outer(mirror, mirror))
    usual, mirrored = _score(board, pose, sigma), _start(other, sigma)[0]
    n = len(board.press)
    return n > 2 and usual > 0.3 * n * OUTLIER**2 and mirrored < 0.3 * usual
