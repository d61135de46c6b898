"""Two lanes of tests: all of them, and what a person waits for, which `tools/test` chooses by measured times.

``pytest --lane quick`` leaves out tests marked ``slow``, and of each function what is beyond ``SECONDS`` of
processor time by ``expensive.txt``; every file keeps one test. ``tools/test --all --measure`` makes it.
"""

from __future__ import annotations

import os
from collections import defaultdict
from pathlib import Path
from typing import Final

import pytest

SECONDS: Final = 0.7
"""Of a function, all its cases together: 2600 functions, most far below: four minutes of two cores."""
LONG_S: Final = 3.0
"""One that begins last keeps the other processes waiting by so much at most."""
TABLE: Final = Path(__file__).parent / "expensive.txt"
_TIMES: Final = "times.{}.txt"


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("skinbus")
    group.addoption("--lane", choices=["quick", "all"], default="all", help="quick: see tests/lanes.py")
    group.addoption("--measure", action="store_true", help="write tests/expensive.txt anew")


def function_of(node_id: str) -> str:
    """Return the function of a test without its parameters."""
    return node_id.partition("[")[0]


def read_table(file: Path = TABLE) -> dict[str, float]:
    """Return the mean processor time of a case of each function that is beyond ``SECONDS``, s."""
    if not file.exists():
        return {}
    rows = (line.split(maxsplit=1) for line in file.read_text(encoding="utf-8").splitlines())
    return {name: float(seconds) for seconds, name in rows}


def quick(cases: list[tuple[str, bool]], mean_s: dict[str, float]) -> list[bool]:
    """Return which cases (node ID, marked slow) are in the quick lane."""
    left: dict[str, float] = defaultdict(lambda: SECONDS)
    chosen, kept = [False] * len(cases), set()
    cheapest: dict[str, tuple[float, int]] = {}
    for k, (node_id, is_slow) in enumerate(cases):
        name, file = function_of(node_id), node_id.partition("::")[0]
        cost = mean_s.get(name, 0.0)
        left[name] -= cost
        chosen[k] = not is_slow and left[name] >= 0.0
        if chosen[k]:
            kept.add(file)
        cheapest[file] = min(cheapest.get(file, (float("inf"), k)), (cost + 1e3 * is_slow, k))
    for file, (_, k) in cheapest.items():
        chosen[k] = chosen[k] or file not in kept
    return chosen


def in_order(node_ids: list[str], mean_s: dict[str, float]) -> list[int]:
    """Return the places of tests, files with one of ``LONG_S`` first: none begins when the others end."""
    longest: dict[str, float] = defaultdict(float)
    files = [node_id.partition("::")[0] for node_id in node_ids]
    for file, node_id in zip(files, node_ids, strict=True):
        longest[file] = max(longest[file], mean_s.get(function_of(node_id), 0.0))
    return sorted(range(len(files)), key=lambda k: -longest[files[k]] if longest[files[k]] >= LONG_S else 0.0)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if "PYTEST_XDIST_WORKER" in os.environ:
        items[:] = [items[k] for k in in_order([item.nodeid for item in items], read_table())]
    if config.getoption("lane") != "quick":
        return
    cases = [(item.nodeid, item.get_closest_marker("slow") is not None) for item in items]
    chosen = quick(cases, read_table())
    config.hook.pytest_deselected(items=[item for item, keep in zip(items, chosen, strict=True) if not keep])
    items[:] = [item for item, keep in zip(items, chosen, strict=True) if keep]


def _used_s() -> float:
    """Return processor time of this process and of its children that have ended, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> object:
    begin_s = _used_s()
    result = yield
    if item.config.getoption("measure"):
        name = _TIMES.format(os.environ.get("PYTEST_XDIST_WORKER", "gw"))
        with (TABLE.parent / name).open("a", encoding="utf-8") as file:
            file.write(f"{_used_s() - begin_s:.3f} {item.nodeid}\n")
    return result


def pytest_unconfigure(config: pytest.Config) -> None:
    """Make the table of what the processes have measured."""
    if not config.getoption("measure") or "PYTEST_XDIST_WORKER" in os.environ:
        return
    cases: dict[str, list[float]] = defaultdict(list)
    for file in sorted(TABLE.parent.glob(_TIMES.format("*"))):
        for seconds, node_id in (line.split(maxsplit=1) for line in file.read_text().splitlines()):
            cases[function_of(node_id)].append(float(seconds))
        file.unlink()
    rows = [(sum(times) / len(times), name) for name, times in cases.items() if sum(times) > SECONDS]
    lines = [f"{seconds:.4f} {name}\n" for seconds, name in sorted(rows, key=lambda row: row[1])]
    TABLE.write_text("".join(lines), encoding="utf-8")
