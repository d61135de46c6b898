"""Calibration: the response of a skin from presses at known places and forces.

A shared radial law, gain, width and offset of each tactel, the noise, the misfit over the distance
(:mod:`.response`), and, where it predicts presses that it was not made from, a smooth map of what that leaves
(:mod:`.residual_map`). Presses that deviate far more than the others are left out and listed. Calibration
runs once, at a desk: numpy, not kernels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.estimate.calibration.residual_map import MAP_REACH, SmoothResiduals, smooth_residuals
from skinbus.estimate.calibration.response import MIN_READINGS, POINTS, Readings, Response
from skinbus.estimate.kernels.layout import limit_of
from skinbus.model import Arm, Radial, ResidualMap

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

REACH = 0.030
"""Distance at which the table ends at first, m: five times the usual thickness of a cover."""
TRIM = 0.002
"""The table is cut where k stays below this part of its peak: a fifth of the usual noise of 1 %."""
MIN_FORCE_RATIO = 1.3
"""The exponent is learned when the largest force is so many times the smallest; else it is 1."""
MAX_ITERATIONS = 60
CHOICES, WIDTHS = 12, 24
"""Iterations in which the weight of the penalty is chosen and the variances are estimated anew; after that
they stay, and then the widths, too. Where no radial law is true (a cone, whose reach grows with the force),
two weights can alternate for ever, and readings change between quiet and pressed."""
SETTLED = 3
"""Iterations after which outliers are looked for: before, the profile is not one."""
TOLERANCE = 1e-5
"""Of the peak: a hundredth of what readings resolve."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """What was learned; ``apply`` puts it into an arm.

    law          the radial law with its misfit; in units of the force of the presses where that is not known
    gain         (n_tactels,) factor from indicated to true pressure, to be used in place of the arm's
    width        (n_tactels,) how much wider each tactel's response is than the law
    bias         (n_tactels,) Pa of true pressure, what each tactel reads too much
    noise        (n_tactels,) standard deviation of a reading, Pa of true pressure
    residual_map (n_tactels, points, points) of values, or None where no smooth map predicts new presses
    residual     root mean square of the weighted residuals; near 1 when the model explains the readings
    n_readings   readings that were used
    outliers     (n,) presses that deviate far more than the others and were left out
    converged    whether the iteration converged; law.misfit is how true the law is
    """

    law: Radial
    gain: Floats
    width: Floats
    bias: Floats
    noise: Floats
    residual_map: ResidualMap | None
    residual: float
    n_readings: int
    outliers: Ints
    converged: bool

    def apply(self, arm: Arm) -> Arm:
        """Return the arm with this response and this noise."""
        patches = []
        for p, placed in enumerate(arm.patches):
            own = self.of(arm.tactels_of(p))
            names = ("law", "gain", "width", "bias", "noise", "residual_map")
            patch = replace(placed.patch, **{name: getattr(own, name) for name in names})
            patches.append(replace(placed, patch=patch))
        return Arm(arm.name, arm.links, patches, *arm.buses, robot=arm.robot)

    def of(self, tactels: slice) -> Calibration:
        """Return what was learned of some tactels, those of a patch."""
        own = self.residual_map
        columns = {name: getattr(self, name)[tactels].copy() for name in ("gain", "width", "bias", "noise")}
        part = None if own is None else ResidualMap(own.step, own.values[tactels].copy())
        return replace(self, residual_map=part, **columns)


def learn_radial_law(
    arm: Arm,
    s: npt.ArrayLike,
    a: npt.ArrayLike,
    force: npt.ArrayLike | None,
    pressures: npt.ArrayLike,
    *,
    link: npt.ArrayLike = 0,
    reach: float = REACH,
    place_sd: float = 0.0,
    maps: bool = True,
) -> Calibration:
    """Return the response of a skin, learned from presses at known places.

    s, a:       (n_presses,) m, places of the presses on their link
    force:      (n_presses,) N; None when it is not known, but the same in all of them
    pressures:  (n_presses, n_tactels) Pa, as the arm's present gains give them; NaN for a missing reading.
                Readings at full scale and those of dead tactels are left out.
    link:       (n_presses,) or one number
    reach:      distance beyond which a press has no effect, m; the table is cut shorter where it can be
    place_sd:   standard deviation of s and a as they are said, m; readings correct them. 0: they are exact
    maps:       whether to try for a map of residuals, which takes most of the time

    Raises:
        ValueError: shapes that do not fit, forces that are not positive, or too few readings to learn from.
    """
    data, learns_exponent = _select(arm, s, a, force, pressures, link, reach, place_sd)
    state = Response(data, arm.n_tactels)
    converged = False
    for iteration in range(MAX_ITERATIONS):
        before = state.prediction
        state.fit_profile(choose=iteration < CHOICES)
        state.fit_tactels(widths=iteration < WIDTHS)
        if iteration >= SETTLED:
            state.fit_presses(refine=iteration < CHOICES)
        if learns_exponent:
            state.fit_exponent()
        if iteration < CHOICES:
            if iteration >= SETTLED:
                state.find_outliers()
            state.fit_variance(to_come=not maps)
        if iteration == CHOICES:
            state.freeze()
        change = np.abs(state.prediction - before).max() / max(np.abs(state.prediction).max(), 1e-300)
        if change < TOLERANCE:
            converged = True
            break
    left, variance = state.residuals[state.kept], state.variance[state.kept]
    smooth = _smooth(arm, data, state) if maps else None
    if maps and smooth is None:
        return learn_radial_law(
            arm, s, a, force, pressures, link=link, reach=reach, place_sd=place_sd, maps=False
        )
    to_newtons = float(np.exp(-state.exponent * data.middle))
    return Calibration(
        law=_trimmed(state, data, to_newtons, has_map=smooth is not None),
        gain=np.asarray(arm.tactel_gain) / state.gain,
        width=state.width,
        bias=state.tactels[:, 2] / state.gain,
        noise=state.noise / state.gain,
        residual_map=None if smooth is None else ResidualMap(smooth.step, smooth.maps * to_newtons),
        residual=float(np.sqrt(np.mean(left**2 / variance))),
        n_readings=int(state.kept.sum()),
        outliers=np.flatnonzero(state.outlier),
        converged=converged,
    )


def _select(
    arm: Arm, s: Any, a: Any, force: Any, pressures: Any, link: Any, reach: float, place_sd: float
) -> tuple[Readings, bool]:
    """Return usable readings, and whether forces differ enough for an exponent."""
    s, a = (np.atleast_1d(np.asarray(x, np.float64)) for x in (s, a))
    table = np.atleast_2d(np.asarray(pressures, np.float64))
    n = len(s)
    if table.shape != (n, arm.n_tactels) or a.shape != (n,):
        wanted = f"({n},) and ({n}, {arm.n_tactels})"
        raise ValueError(f"a and pressures must have shapes {wanted}, got {a.shape} and {table.shape}")
    forces = np.ones(n) if force is None else np.broadcast_to(np.asarray(force, np.float64), n)
    if not (np.isfinite(forces) & (forces > 0.0)).all():
        raise ValueError("forces must be finite and positive")
    links = np.broadcast_to(np.asarray(link), n)
    if not reach > 0.0:
        raise ValueError(f"reach must be positive, got {reach}")

    d = np.full(table.shape, np.inf)
    away = np.zeros((*table.shape, 2))
    for number in np.unique(links):
        rows, columns = np.flatnonzero(links == number), np.flatnonzero(arm.tactel_link == number)
        surface, here = arm.links[number].surface, np.ix_(rows, columns)
        d[here] = surface.distance(s[rows, None], a[rows, None], arm.tactel_s[columns], arm.tactel_a[columns])
        along = s[rows, None] - arm.tactel_s[columns]
        away[here] = np.stack([along, surface.wrap(a[rows, None] - arm.tactel_a[columns])], -1)
    usable = np.isfinite(table) & (d < reach) & arm.tactel_healthy & (table < limit_of(arm))
    if usable.sum() < MIN_READINGS:
        raise ValueError(
            f"only {usable.sum()} usable readings within {1e3 * reach:g} mm of a press; {MIN_READINGS} needed"
        )
    if not (table[usable] > 0.0).any():
        raise ValueError("no reading is above zero: were the places pressed at all?")
    press, tactel = np.nonzero(usable)
    log_force = np.log(forces[press])
    steps = np.array([placed.patch.transducer.resolution for placed in arm.patches])
    readings = Readings(
        p=table[press, tactel],
        press=press,
        tactel=tactel,
        d=d[press, tactel],
        away=away[press, tactel],
        log_force=log_force - log_force.mean(),
        middle=float(log_force.mean()),
        n_presses=n,
        step=reach / (POINTS - 1),
        floor=steps[arm.tactel_patch] * arm.tactel_gain / math.sqrt(12.0),
        place_sd=place_sd,
    )
    return readings, force is not None and bool(forces.max() >= MIN_FORCE_RATIO * forces.min())


def _smooth(arm: Arm, data: Readings, state: Response, *, again: bool = True) -> SmoothResiduals | None:
    """Return the smooth map of the residuals, if there is one; bring the misfit to what it leaves."""
    kept = np.flatnonzero(state.kept)
    tactel, amplitude = data.tactel[kept], state.amplitude[kept]
    yaw = np.array([placed.yaw for placed in arm.patches])[arm.tactel_patch[tactel]]
    on_board = (state.away[kept] @ [1.0, 1j]) * np.exp(-1j * yaw)
    smooth = smooth_residuals(
        np.stack([on_board.real, on_board.imag], -1),
        tactel,
        state.residuals[kept] / amplitude,
        np.sqrt(state.variance[kept]) / amplitude,
        arm.n_tactels,
    )
    if smooth is None:
        return None
    left = state.residuals
    left[kept] = smooth.left * amplitude
    if again and state.find_outliers(left):
        # beside the map an outlier that the law alone could hide stands out
        return _smooth(arm, data, state, again=False)
    state.fit_variance(left, to_come=True)
    return smooth


def _trimmed(state: Response, data: Readings, to_newtons: float, *, has_map: bool) -> Radial:
    """Return the law in newtons, cut where it has faded, not within a map, on all points again."""
    table = np.append(state.table, 0.0) * to_newtons
    if not table[0] > 0.0:
        raise ValueError("the readings do not rise towards the presses: are the places right?")
    last = int(np.flatnonzero(np.abs(table) > TRIM * table[0]).max()) + 1
    whole = data.step * (POINTS - 1)
    reach = min(max(data.step * (last + 1), MAP_REACH if has_map else 0.0), whole)
    step = reach / (POINTS - 1)
    at = np.asarray(step * np.arange(POINTS), np.float64)
    fine = Radial(data.step, table).profile(at)
    fine[-1] = 0.0
    misfit = np.sqrt(state.misfit_at(at) ** 2 + state.unknown_at(at, has_map=has_map))
    return Radial(
        step,
        fine,
        exponent=state.exponent,
        misfit=state.misfit,
        misfit_profile=misfit * to_newtons,
        typical_force=float(np.exp(data.middle)),
    )
