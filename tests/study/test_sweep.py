"""The grid: the same numbers wherever it runs, nothing lost when it is killed, the bound under the errors."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from skinbus.errors import ConfigError
from skinbus.model import Arm, Cone
from skinbus.model.patch import grid
from skinbus.study.cases import Case
from skinbus.study.cell import Cell, run_cell
from skinbus.study.compare import regressions
from skinbus.study.crb import bound, ideal_distances, position_bound
from skinbus.study.methods import make_method, methods_here
from skinbus.study.sweep import (
    executor_of,
    full_grid,
    quick_grid,
    read_table,
    run_sweep,
    write_parquet,
)
from tests.study.dask_sweep import CELLS

ROOT = Path(__file__).parents[2]

TIMES = (
    "compute_p50_us",
    "compute_p99_us",
    "reference_us",
    "time_ratio",
    "latency_p50_us",
    "latency_p99_us",
    "touch_p50_us",
    "touch_p99_us",
)
"""Columns that differ from run to run; all others are fixed by the cell and the versions."""


class Here:
    """An executor that runs in this process when asked for the result, and can break down."""

    def __init__(self, breaks_after=10**9):
        self.left = breaks_after

    def submit(self, function, *arguments):
        from concurrent.futures import Future

        future = Future()
        self.left -= 1
        if self.left < 0:
            future.set_exception(KeyboardInterrupt())
        else:
            future.set_result(function(*arguments))
        return future


def numbers(rows):
    """Rows without what differs from run to run."""
    return [{key: value for key, value in row.items() if key not in TIMES} for row in rows]


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    file = tmp_path_factory.mktemp("sweep") / "table.csv"
    run_sweep(CELLS, file, Here())
    return file


def test_killed_run_keeps_what_has_come_and_goes_on_from_there(table, tmp_path):
    file = tmp_path / "killed.csv"
    with pytest.raises(KeyboardInterrupt):
        run_sweep(CELLS, file, Here(breaks_after=2))
    kept = file.read_text() if file.exists() else ""
    if kept:  # as_completed gives the failure in any order
        assert len(read_table(file)) in (1, 2)
    # A kill in the middle of a line.
    file.write_text(kept + "one,kmeans,cone,4,16")
    steps = []
    run_sweep(CELLS, file, Here(), done=steps.append)
    assert set(kept.splitlines()) <= set(file.read_text().splitlines())
    assert sum(steps) == len(CELLS)
    whole, again = read_table(table), read_table(file)
    assert numbers(again[key] for key in sorted(again)) == numbers(whole[key] for key in sorted(whole))


def test_finished_table_is_not_run_again(table):
    before = table.read_bytes()
    rows = run_sweep(CELLS, table, Here(breaks_after=0))
    assert len(rows) == len(CELLS)
    assert table.read_bytes() == before


def test_file_of_another_kind_is_refused(tmp_path):
    file = tmp_path / "other.csv"
    file.write_text("a,b\n1,2\n")
    with pytest.raises(ConfigError, match="family"):
        read_table(file)


@pytest.mark.slow
def test_processes_give_the_numbers_of_this_process(table, tmp_path):
    file = tmp_path / "processes.csv"
    with executor_of(workers=2) as executor:
        run_sweep(CELLS, file, executor)
    there, here = read_table(file), read_table(table)
    assert numbers(there[key] for key in sorted(there)) == numbers(here[key] for key in sorted(here))


@pytest.mark.slow
def test_dask_cluster_gives_the_numbers_of_this_process(table, tmp_path):
    file = tmp_path / "dask.csv"
    command = [sys.executable, "-m", "tests.study.dask_sweep", str(file)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    there, here = read_table(file), read_table(table)
    assert numbers(there[key] for key in sorted(there)) == numbers(here[key] for key in sorted(here))


def test_parquet_holds_the_numbers_of_the_table(table, tmp_path):
    rows = read_table(table)
    write_parquet(list(rows.values()), tmp_path / "table.parquet")
    again = read_table(tmp_path / "table.parquet")
    assert list(again) == list(rows)
    for key, row in rows.items():
        assert {k: v for k, v in again[key].items() if v == v} == {k: v for k, v in row.items() if v == v}


def test_budget_is_an_axis_with_numbers_of_its_own_that_are_the_same_every_time():
    whole, *cut = (
        run_cell(Cell(family="two", method="full", trials=30, budget=budget)) for budget in (0, 10, 10)
    )
    assert numbers([cut[0]]) == numbers([cut[1]])
    assert cut[0]["position_rms_mm"] > whole["position_rms_mm"]
    with pytest.raises(ValueError, match="budget"):
        make_method("scipy kmeans2", Arm.single_patch(grid(4, 4, 0.01)), n_touches=1, budget=5)


def test_touch_waits_for_its_sync_on_top_of_the_latency(table):
    for row in read_table(table).values():
        assert 1.4 * row["latency_p50_us"] < row["touch_p50_us"] < row["touch_p99_us"]
        assert row["touch_p99_us"] < 2.0 * row["latency_p99_us"]


def test_rows_say_what_made_them_and_what_they_cost(table):
    for row in read_table(table).values():
        assert row["wire_us"] > 4 * 100
        assert row["latency_p99_us"] >= row["wire_us"] + row["compute_p50_us"]
        assert row["skinbus"]
        assert row["machine"]
        assert row["position_p99_mm"] >= row["position_p95_mm"] >= row["position_median_mm"]


def test_bits_change_rounding_and_wire_but_not_the_touches():
    cases = [Case("two", side=4, law="cone", bits=bits, seed=1) for bits in (8, 16)]
    trials = [case.trial() for case in cases]
    assert np.array_equal(trials[0].touches, trials[1].touches)
    off = np.abs(trials[0].pressures - trials[1].pressures)
    assert 0.0 < off.max() <= 0.5 * 250e3 / 127 + 250e3 / 0x7FFF
    wide, narrow = (run_cell(Cell(method="kmeans", bits=b, trials=4))["wire_us"] for b in (16, 8))
    assert narrow < wide


def test_bound_is_the_one_known_in_closed_form_for_the_force_of_a_fixed_place():
    """For p = F g alone the bound is sigma^2 / sum g^2; with place unknown it can only be larger."""
    uv = grid(8, 8, 0.004)
    g = np.exp(-((uv**2).sum(1)) / (2 * 0.006**2))

    def predict(touches):
        (s, a, force) = touches[0]
        return force * np.exp(-(((uv - [s, a]) ** 2).sum(1)) / (2 * 0.006**2))

    covariance = bound(predict, np.array([[0.0, 0.0, 5.0]]), 0.02)[0]
    assert covariance[2, 2] == pytest.approx(0.02**2 / (g**2).sum(), rel=1e-3)  # by symmetry no coupling
    # place: dp/ds = F u g / w^2
    information = (5.0 * uv[:, 0] * g / 0.006**2) ** 2
    assert covariance[0, 0] == pytest.approx(0.02**2 / information.sum(), rel=1e-3)


def test_touch_that_nothing_feels_has_no_bound():
    arm = Arm.single_patch(grid(4, 4, 0.01))
    law = Cone(5e6)

    def predict(touches):
        d = np.hypot(arm.tactel_s - touches[:, :1], arm.tactel_a - touches[:, 1:2])
        return law.pressure(d, touches[:, 2:]).sum(0)

    assert np.isnan(bound(predict, np.array([[0.2, 0.2, 1.0]]), 200.0)).all()
    assert np.isfinite(position_bound(bound(predict, np.array([[0.001, 0.002, 8.0]]), 200.0))).all()


def test_touch_that_is_not_determined_leaves_the_bounds_of_others():
    rng = np.random.default_rng(7)
    places = np.array([[x, y] for x in range(4) for y in range(4)]) * 0.01

    def predict(touches):
        d2 = ((touches[:, None, :2] - places) ** 2).sum(-1)
        return (touches[:, 2:] * 1e4 * np.maximum(1.0 - d2 / 0.012**2, 0.0) ** 2).sum(0)

    seen, unseen = [0.014, 0.016, 5.0], [0.2, 0.2, 5.0]
    alone = bound(predict, np.array([seen]), 200.0)
    both = bound(predict, np.array([unseen, seen]), 200.0)
    assert np.isnan(both[0]).all()
    np.testing.assert_allclose(both[1], alone[0], rtol=1e-9)
    off = ideal_distances(both, 20_000, rng)
    assert np.isinf(off[0]).all()
    rms = np.sqrt((off[1] ** 2).mean())
    np.testing.assert_allclose(rms, position_bound(both)[1], rtol=0.03)


def test_fit_reaches_the_bound_and_the_centroid_does_not():
    rows = {m: run_cell(Cell(method=m, trials=120)) for m in ("kmeans", "fit")}
    assert 0.85 < rows["fit"]["crb_ratio"] < 1.15
    assert rows["kmeans"]["crb_ratio"] > 5.0


@pytest.mark.parametrize("name", methods_here())
def test_every_method_finds_one_clear_touch(name):
    case = Case("one", side=4, law="elastic-radial", bits=16, seed=0)
    method = make_method(name, case.arm, n_touches=1)
    for _ in range(5):
        trial = case.trial()
        contacts = method(trial.pressures)
        assert len(contacts) == 1
        assert np.hypot(*(contacts[0, :2] - trial.touches[0, :2])) < 2e-3
        assert contacts[0, 2] == pytest.approx(trial.touches[0, 2], rel=0.2)


def test_grids_hold_every_cell_once():
    for cells in (full_grid(), quick_grid()):
        assert len({cell.key for cell in cells}) == len(cells)


def test_worse_front_is_noticed_and_the_same_is_not(table):
    stored = read_table(table)
    assert regressions(stored, stored) == []
    key = next(iter(stored))
    worse = {
        **stored,
        key: {**stored[key], "position_median_mm": 1.2 * stored[key]["position_median_mm"] + 0.1},
    }
    assert any("position_median_mm" in fault for fault in regressions(worse, stored))
    slow = {k: {**row, "time_ratio": 1.6 * row["time_ratio"]} for k, row in stored.items()}
    assert len(regressions(slow, stored)) == 2
    assert any("not measured" in fault for fault in regressions({}, stored))
