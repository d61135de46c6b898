"""What a master needs is compiled by other processes, and then only loaded."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skinbus.estimate import LEVELS
from skinbus.skin.compile_ahead import BASE, PARTS, SIMULATED, first_level, is_kept, parts_of
from tests.cli.patience import PATIENCE_S

COMPILE = """
from skinbus.skin.compile_ahead import compile_missing, is_kept

assert not is_kept("tracking")
numbers, ended = [], []
compile_missing(["tracking"], lambda n: numbers.append(n) or (lambda: ended.append(1)))
assert (numbers, ended) == ([1], [1])
assert is_kept("tracking")  # loaded, for compiling is refused here
compile_missing(["tracking"], lambda n: numbers.append(n))
assert numbers == [1]
"""


def run(code, folder):
    return subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip


@pytest.mark.slow  # compiles for 10 s
def test_part_that_is_not_kept_is_compiled_once_by_another_process(tmp_path):
    done = run(COMPILE, tmp_path)
    assert done.returncode == 0, done.stderr


AT_ONCE = """
import os
from skinbus.skin.compile_ahead import is_kept, start

for process in [start("tracking"), start("tracking")]:
    assert process.wait() == 0
assert is_kept("tracking")
process = start("kmeans")
print(process.pid, flush=True)
os._exit(0)  # without a word, as one that is killed
"""


@pytest.mark.slow  # compiles for 20 s
def test_compiling_goes_on_when_who_asked_for_it_has_ended(tmp_path):
    done = run(AT_ONCE, tmp_path)
    assert done.returncode == 0, done.stderr
    end = time.monotonic() + PATIENCE_S
    while is_running(done.stdout.strip()):
        assert time.monotonic() < end
        time.sleep(0.05)  # between two looks at another process
    done = run("from skinbus.skin.compile_ahead import is_kept; print(is_kept('kmeans'))", tmp_path)
    assert done.stdout.strip() == "True"


def is_running(pid):
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
def test_without_a_place_for_kernels_no_process_is_started(tmp_path):
    (tmp_path / "file").touch()
    code = "from skinbus.skin.compile_ahead import *; compile_missing(PARTS, 0); print(first_level('full'))"
    done = run(code, tmp_path / "file")
    assert done.stdout.strip() == "full"
    assert done.returncode == 0, done.stderr


def test_level_needs_its_own_kernels_and_those_below():
    assert parts_of("kmeans") == BASE
    assert set(parts_of(LEVELS[-1], SIMULATED)) == set(PARTS)


def test_level_whose_kernel_is_kept_is_the_first():
    PARTS["fit"]()  # compiled now, if it was not
    assert is_kept("fit")
    assert first_level("fit") == "fit"
