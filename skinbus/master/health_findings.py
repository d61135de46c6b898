"""What the health of a skin says: which tactels changed since commissioning, and what to replace."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import TactelFault
from skinbus.master.health import BoardHealth, HealthColumns
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]

NOISY: Final = 3.0
"""Times its first noise, and the noise of its file: three times noisier is a fault of the tactel."""
GAIN: Final = 0.15
"""Change of a gain: three times the repeatability that data sheets state; a contact errs by as much."""
SCALED: Final = 1.6
"""Factor common to the noise of a board from which its readings may be scaled: references err by a tenth."""
SIGMAS: Final = 4.0
SLOPE: Final = 0.5
"""Difference of a slope from 1: such a tactel leaves half of every change of temperature in its readings."""
FAULTY_SHARE: Final = 0.15
"""Part of a board's tactels with findings from which the board is to be replaced: 3 of 16."""
OFTEN: Final = 10
"""Times that a tactel became implausible from which that is a finding by itself."""


@dataclass(frozen=True, slots=True)
class HealthFinding:
    """One thing to say of a board."""

    patch: int
    tactels: tuple[int, ...]
    """From 1; none for the whole board."""
    what: str
    advice: str


def findings(arm: Arm, boards: Sequence[BoardHealth | None]) -> list[HealthFinding]:
    """Return what is to be said of the boards of an arm."""
    found: list[HealthFinding] = []
    for p, board in enumerate(boards):
        if board is not None:
            found += _of_board(arm, p, board)
    return found


def slopes(columns: HealthColumns) -> Floats:
    """Return the slope of each zero on that of its board, (n_tactels,); NaN where the board has not moved."""
    noise = np.nan_to_num(columns.noise, nan=np.inf)
    # the mean of a board has to have moved by a few times what a single zero errs
    moved = np.sqrt(columns.board_square / np.maximum(columns.samples, 1.0)) > 0.5 * noise
    return np.where(moved, columns.product / np.where(moved, columns.board_square, 1.0), np.nan)


def _of_board(arm: Arm, p: int, board: BoardHealth) -> Iterator[HealthFinding]:
    here, own = arm.tactels_of(p), board.columns
    healthy = arm.tactel_healthy[here]
    band = arm.tactel_zero_band[here]
    seen = own.seen.astype(np.int64)
    with np.errstate(invalid="ignore"):
        noisy = (own.noise > NOISY * own.noise_first) & (own.noise > NOISY * arm.tactel_noise[here])
        moved = np.abs(own.zero - own.zero_first) > band
        change, sd = board.gains.changes()
        weak = (np.abs(change) > GAIN) & (np.abs(change) > SIGMAS * sd)
        crooked = np.abs(slopes(own) - 1.0) > SLOPE
    dead = (seen & int(TactelFault.DEAD | TactelFault.FROZEN)) != 0
    often = (own.faults >= OFTEN) & ~dead
    worst = np.zeros(len(healthy), np.bool_)
    rows = (
        (dead, "dead or frozen at times", 'clear their bits in "Healthy tactels"'),
        (often, f"implausible {OFTEN} times or more", "look at connector and cable of the board"),
        (
            noisy,
            f"noise {NOISY:g} times that at commissioning",
            "look at cable and shield; else take them out",
        ),
        (
            moved,
            "zeros moved by more than their band",
            "look for what presses; else calibrate the board again",
        ),
        (weak, f"gain changed by more than {100 * GAIN:.0f} %", "calibrate the board again"),
        (crooked, "zeros do not move with those of their board", "calibrate at working temperature"),
    )
    for is_so, what, advice in rows:
        is_so = is_so & healthy
        worst |= is_so
        if is_so.any():
            yield HealthFinding(p, tuple((1 + np.flatnonzero(is_so)).tolist()), what, advice)
    with np.errstate(invalid="ignore", divide="ignore"):
        grown = np.log(own.noise / own.noise_first)
    grown = grown[healthy & np.isfinite(grown) & ~worst]
    factor, error = (grown.mean(), grown.std() / np.sqrt(len(grown))) if len(grown) else (0.0, 0.0)
    if abs(factor) > max(np.log(SCALED), SIGMAS * error):
        what = f"noise of the whole board {np.exp(factor):.1f} times that at commissioning"
        yield HealthFinding(p, (), what, "press it with a known force: its readings may be scaled")
    if worst.sum() > FAULTY_SHARE * len(healthy):
        n = int(worst.sum())
        yield HealthFinding(p, (), f"{n} of {len(healthy)} tactels have findings", "replace the board")
