"""One cell of the grid: a method on a case, its errors beside the Cramer-Rao bound, and its time.

Times are of the processor, not of the clock on the wall: what else a machine does is no property of a method.
A touch comes at any time before the SYNC that samples it; its latency is that of the fastest SYNC which keeps
up: one cycle after the other, readings, 99 % of the computing, contacts.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.can.classic_bits import frame_bits
from skinbus.can.frame import Frame
from skinbus.objects.cia import SYNC_ID, TPDO_BASES
from skinbus.objects.published import usual
from skinbus.study.cases import Case
from skinbus.study.crb import bound, ideal_distances, position_bound
from skinbus.study.methods import make_method
from skinbus.study.score import GATE

Floats = npt.NDArray[np.float64]

BITRATE: Final = 1_000_000
IDEAL_DRAWS: Final = 16
"""Of an ideal estimate, for each touch: their median is sharper than that of the errors."""
_WIRE_TRIALS: Final = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """The coordinates of a cell; equal cells give equal numbers, times aside."""

    family: str = "one"
    method: str = "fit"
    law: str = "cone"
    side: int = 4
    """Tactels along a side of a board."""
    bits: int = 16
    """Of the converter; up to 8 travel as a byte, more as two."""
    iterations: int = 0
    """Bound on the iterations of a method that has one; 0 for none."""
    budget: int = 0
    """Work that a level of ours may do in a cycle, pressures evaluated; 0 for no limit."""
    trials: int = 200
    seed: int = 0

    @property
    def key(self) -> str:
        """What names the cell in a table."""
        return "/".join(str(value) for value in asdict(self).values())


def run_cell(cell: Cell) -> dict[str, Any]:
    """Return the row of a cell: its coordinates, errors, bound and times."""
    case = Case(cell.family, side=cell.side, law=cell.law, bits=cell.bits, seed=cell.seed)
    method = make_method(
        cell.method,
        case.arm,
        n_touches=case.n_touches,
        iterations=cell.iterations,
        budget=cell.budget,
        seed=zlib.crc32(cell.key.encode()) % 2**31,
    )
    trials = [case.trial() for _ in range(cell.trials)]
    method(trials[0].pressures)  # what the first call has to load is not part of a cycle
    reference = make_reference()

    answers, times_ns, reference_ns = [], [], []
    for trial in trials:
        begin = time.process_time_ns()
        contacts = method(trial.pressures)
        between = time.process_time_ns()
        times_ns.append(between - begin)
        answers.append(contacts)
        reference()
        reference_ns.append(time.process_time_ns() - between)

    surface = case.arm.links[0].surface
    position, force, ideal, ratios, ideal_ratios = [], [], [], [], []
    rng = np.random.default_rng(cell.seed)  # of the ideal estimates
    wrong = missed = 0
    for trial, contacts in zip(trials, answers, strict=True):
        truth = trial.touches
        wrong += len(contacts) != len(truth)
        d = surface.distance(truth[:, :1], truth[:, 1:2], contacts[:, 0], contacts[:, 1])
        rows, columns = linear_sum_assignment(np.minimum(d, 10.0 * GATE))
        near = d[rows, columns] <= GATE
        rows, columns = rows[near], columns[near]
        missed += len(truth) - len(rows)
        position += d[rows, columns].tolist()
        force += (np.abs(contacts[columns, 2] - truth[rows, 2]) / truth[rows, 2]).tolist()
        bounds = bound(case.predict, truth, case.sigma)
        least, off = position_bound(bounds), ideal_distances(bounds, IDEAL_DRAWS, rng)
        ideal += off.ravel().tolist()
        ratios += (d[rows, columns] / least[rows]).tolist()
        ideal_ratios += (off[rows] / least[rows, None]).ravel().tolist()

    readings_us, contacts_us = _wire_us(case, [t.pressures for t in trials[:_WIRE_TRIALS]], cell.bits)
    p50, p99 = np.percentile(times_ns, [50, 99]) / 1e3
    # Disturbances only ever add time, and reach both: the quarter of each that was disturbed least.
    quick_us, reference_us = (float(np.percentile(ns, 25)) / 1e3 for ns in (times_ns, reference_ns))
    period_us = readings_us + float(p99) + contacts_us
    return {
        **asdict(cell),
        "tactels": case.arm.n_tactels,
        "patches": case.arm.n_patches,
        "position_median_mm": _of(position, np.median, 1e3),
        "position_rms_mm": _of(position, _rms, 1e3),
        "position_p95_mm": _of(position, _p95, 1e3),
        "position_p99_mm": _of(position, _p99, 1e3),
        # The median error of an ideal estimate, over all touches: infinite when half of them have no bound.
        "crb_mm": 1e3 * float(np.median(ideal)),
        # Of touches that have a bound.
        "crb_ratio": _of(ratios, np.median, 1.0) / _of(ideal_ratios, np.median, 1.0),
        "force_median_pct": _of(force, np.median, 1e2),
        "force_p95_pct": _of(force, _p95, 1e2),
        "missed_pct": 100.0 * missed / (cell.trials * case.n_touches),
        "wrong_count_pct": 100.0 * wrong / cell.trials,
        "compute_p50_us": float(p50),
        "compute_p99_us": float(p99),
        "reference_us": reference_us,
        "time_ratio": quick_us / reference_us,
        "wire_us": readings_us + contacts_us,
        "latency_p50_us": readings_us + float(p50) + contacts_us,
        "latency_p99_us": readings_us + float(p99) + contacts_us,
        "touch_p50_us": 0.50 * period_us + readings_us + float(p50) + contacts_us,
        "touch_p99_us": 0.99 * period_us + readings_us + float(p99) + contacts_us,
    }


def make_reference() -> Callable[[], object]:
    """Return a fixed piece of work, some 20 us of Python, NumPy and LAPACK: what times are compared by."""
    matrix = np.add.outer(np.arange(24.0), np.arange(24.0)) % 7.0 + 24.0 * np.eye(24)

    def work() -> None:
        for _ in range(4):
            np.linalg.solve(matrix, matrix[0])

    work()
    return work


def _wire_us(case: Case, pressures: list[Floats], bits: int) -> tuple[float, float]:
    """Return the mean wire time of SYNC and readings, and of contacts and summary, us: exact bits."""
    width = 1 if bits <= 8 else 2
    per_frame = 8 // width
    objects = usual()
    n_readings = n_contacts = 0
    for k, row in enumerate(pressures):
        n_readings += frame_bits(Frame(SYNC_ID, bytes([1 + k % 240])))
        counts = case.counts(row)
        for p in range(case.arm.n_patches):
            own = counts[case.arm.tactels_of(p)] << (8 * width - bits)  # left-adjusted: CiA 401
            data = own.astype("<i2" if width == 2 else "i1").tobytes()
            for number, start in enumerate(range(0, len(data), per_frame * width)):
                base = TPDO_BASES[number % len(TPDO_BASES)]
                cob_id = base + 1 + p + case.arm.n_patches * (number // len(TPDO_BASES))
                n_readings += frame_bits(Frame(cob_id, data[start : start + 8]))
        for c in range(case.n_touches):
            contact = bytes([1 + c, 0x20, 250 - k, 0, 3 * k, 0, 88 + k, 2])
            n_contacts += frame_bits(Frame(objects.contact_ids[c], contact))
        summary = bytes([1 + k, case.n_touches, case.arm.n_patches, 0, 80, 1, 44, 0])
        n_contacts += frame_bits(Frame(objects.summary.cob_id, summary))
    us_per_bit = 1e6 / BITRATE / len(pressures)
    return n_readings * us_per_bit, n_contacts * us_per_bit


def _of(values: list[float], statistic: Callable[[Any], Any], scale: float) -> float:
    finite = [v for v in values if np.isfinite(v)]
    return scale * float(statistic(finite)) if finite else float("nan")


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _p95(values: Any) -> float:
    return float(np.percentile(values, 95))


def _p99(values: Any) -> float:
    return float(np.percentile(values, 99))
