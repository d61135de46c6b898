"""Grids of cells, run side by side, appended to one table as they come; a killed run goes on from there.

Processes of this machine and a Dask cluster stand behind one interface, ``concurrent.futures.Executor``.
"""

from __future__ import annotations

import csv
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numba
import numpy as np

from skinbus import __version__
from skinbus.errors import ConfigError, Fault, SkinbusError
from skinbus.estimate import LEVELS
from skinbus.study.cases import FAMILIES, LAWS, PITCHES
from skinbus.study.cell import Cell, run_cell
from skinbus.study.methods import SCIPY_FIT, SCIPY_KMEANS, SKLEARN_KMEANS, methods_here
from skinbus.study.sources import code_stamp

BITS: Final = (4, 6, 8, 10, 12, 16)
ITERATIONS: Final = (1, 2, 3, 4, 6, 8, 12, 20)
BUDGETS: Final = (1, 30, 100, 300, 1000, 3000, 10_000, 30_000, 100_000)
"""Pressures evaluated: from one step of a fit on one board to more than five touches on an arm need."""
THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""One thread for each process: small problems that many threads wait for take a hundred times as long."""
SLOW_TRIALS: Final = 40
"""Cycles of methods that take tens of milliseconds each."""
QUICK_TRIALS: Final = 40

Row = dict[str, Any]

PARQUET: Final = ".parquet"
"""Files that end so are Parquet, all others CSV."""


def full_grid(seeds: Sequence[int] = (0, 1)) -> list[Cell]:
    """Return the cells behind every table and figure of the docs."""
    methods = methods_here()
    cells = [
        Cell(family=family, method=method, law=law)
        for law in LAWS
        for family in FAMILIES
        for method in methods
    ]
    cells += [
        Cell(family=family, method=method, law=law, iterations=n)
        for law in ("cone", "elastic-radial")
        for family in ("one", "two")
        for method in (SCIPY_FIT, SCIPY_KMEANS, SKLEARN_KMEANS)
        if method in methods
        for n in ITERATIONS
    ]
    cells += [
        Cell(family=family, method=level, law=law, budget=budget)
        for law in ("cone", "elastic-radial")
        for family in ("two", "forearm")
        for level in LEVELS[1:]
        for budget in BUDGETS
    ]
    cells += [
        Cell(family=family, method=level, law="elastic-radial", bits=bits)
        for family in ("one", "two", "forearm")
        for level in LEVELS
        for bits in BITS
    ]
    cells += [
        Cell(family=family, method=level, law=law, side=side)
        for law in LAWS
        for family in ("one", "two")
        for level in LEVELS
        for side in PITCHES
    ]
    once = dict.fromkeys(cells)
    return [_bounded(replace(cell, seed=seed)) for seed in seeds for cell in once]


def quick_grid() -> list[Cell]:
    """Return cells that take a minute at most: what a change of the code is held against."""
    return [
        Cell(family=family, method=method, law=law, trials=QUICK_TRIALS)
        for law in ("cone", "elastic-radial")
        for family in FAMILIES
        for method in (*LEVELS, SCIPY_KMEANS)
    ]


def run_sweep(
    cells: Iterable[Cell],
    file: Path,
    executor: Executor,
    *,
    done: Callable[[int], None] = lambda n: None,
) -> list[Row]:
    """Run the cells that a table does not hold yet, append each as it comes, and return all rows asked for.

    Rows that other code has made are not kept; the finished table is in the order of the cells, whichever
    came first. ``done`` is called with the number of cells at each step, those found in the table first.

    Raises:
        ConfigError: the file is no table of this kind.
    """
    wanted = {cell.key: cell for cell in cells}
    found = read_table(file)
    current = {key: row for key, row in found.items() if row.get("sources") == provenance()["sources"]}
    if len(current) < len(found):
        _write(file, current.values())
    rows = {key: row for key, row in current.items() if key in wanted}
    done(len(rows))
    missing = [cell for key, cell in wanted.items() if key not in rows]
    futures = {executor.submit(run_cell, cell): cell for cell in missing}
    try:
        for future in as_completed(futures):
            row = {**future.result(), **provenance()}
            append(file, row)
            rows[futures[future].key] = row
            done(1)
    except BaseException:  # an interrupt above all: what has come is in the table
        for future in futures:
            future.cancel()
        raise
    in_order = [rows[key] for key in wanted]
    _write(file, [*in_order, *(row for key, row in current.items() if key not in wanted)])
    return in_order


@contextmanager
def executor_of(scheduler: str | None = None, workers: int | None = None) -> Iterator[Executor]:
    """Give an executor: processes of this machine, or a Dask cluster at an address such as tcp://host:8786.

    Raises:
        SkinbusError: Dask is not installed, or nobody answers at the address.
    """
    if scheduler is None:
        # Spawned, not forked: the parent may have threads of numba and of the progress bar.
        pool = ProcessPoolExecutor(workers or os.cpu_count(), mp_context=get_context("spawn"))
        before = {name: os.environ.get(name) for name in THREADS}
        os.environ.update(dict.fromkeys(THREADS, "1"))
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise SkinbusError(
            f"a cluster needs dask.distributed ({error}); pip install 'skinbus[cluster]'"
        ) from error
    try:
        client: Any = Client(scheduler, timeout="10s")  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise SkinbusError(f"no Dask scheduler at {scheduler}: {error}") from error
    with client:
        yield client.get_executor(pure=False)


def read_table(file: Path) -> dict[str, Row]:
    """Return the rows of a table by the key of their cell; a last line cut short by a kill is dropped.

    Raises:
        ConfigError: the columns are not those of a cell.
    """
    if not file.exists():
        return {}
    if file.suffix == PARQUET:
        _, parquet = need_parquet()
        return _by_key(file, parquet.read_table(file).to_pylist(), parquet.read_schema(file).names)
    try:
        text = file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(str(file), [Fault("file", None, "a table of `skinbus study run`")]) from error
    whole = text[: text.rfind("\n") + 1]
    reader = csv.DictReader(whole.splitlines())
    rows = ({key: _value(key, value) for key, value in row.items() if key is not None} for row in reader)
    table = _by_key(file, rows, reader.fieldnames or ()) if whole else {}
    if len(whole) < len(text):  # not before it is known to be such a table
        file.write_text(whole)
    return table


def write_parquet(rows: Sequence[Row], file: Path) -> None:
    """Write rows as a Parquet file, with the types of their columns.

    Raises:
        SkinbusError: pyarrow is not installed.
    """
    pyarrow, parquet = need_parquet()
    parquet.write_table(pyarrow.Table.from_pylist(list(rows)), file)


def need_parquet() -> tuple[Any, Any]:
    """Return pyarrow and its module for Parquet; SkinbusError where it is not installed."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise SkinbusError(f"Parquet needs pyarrow ({error}); pip install 'skinbus[parquet]'") from error
    return pyarrow, parquet


def _write(file: Path, rows: Iterable[Row]) -> None:
    """Write a table anew, as a whole."""
    unfinished = file.with_suffix(".unfinished")
    unfinished.write_text("")
    for row in rows:
        append(unfinished, row)
    unfinished.replace(file)


def append(file: Path, row: Row) -> None:
    """Add one row, whole, to a table; the first brings the head."""
    new = not file.exists() or not file.stat().st_size
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("a", newline="") as out:
        writer = csv.DictWriter(out, list(row))
        if new:
            writer.writeheader()
        writer.writerow({key: f"{v:.6g}" if isinstance(v, float) else v for key, v in row.items()})


@cache
def provenance() -> Row:
    """Return what made the numbers: versions, code and machine."""
    return {
        "sources": code_stamp(["skinbus.study.cell"]),
        "skinbus": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "machine": f"{platform.machine()} {platform.processor() or platform.system()} x{os.cpu_count()}",
    }


def _by_key(file: Path, rows: Iterable[Row], columns: Sequence[str]) -> dict[str, Row]:
    """Return the rows by the key of their cell; ConfigError if columns of a cell are missing."""
    names = [field.name for field in fields(Cell)]
    if absent := [name for name in names if name not in columns]:
        raise ConfigError(str(file), [Fault("columns", list(columns), f"also {', '.join(absent)}")])
    return {Cell(**{name: row[name] for name in names}).key: row for row in rows}


_TEXT: Final = {"family", "method", "law", "sources", "skinbus", "python", "numpy", "numba", "machine"}
_WHOLE: Final = {"side", "bits", "iterations", "budget", "trials", "seed", "tactels", "patches"}


def _value(key: str, text: str | None) -> Any:
    if key in _TEXT:
        return text
    if text is None or text == "":
        return float("nan")
    return int(text) if key in _WHOLE else float(text)


def _bounded(cell: Cell) -> Cell:
    return replace(cell, trials=SLOW_TRIALS) if cell.method == SCIPY_FIT else cell
