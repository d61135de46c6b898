"""Another process compiles what `fit` needs, once, to its end; the master runs at `kmeans` meanwhile."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from skinbus.skin import compile_ahead
from tests.cli.patience import PATIENCE_S, wait_until
from tests.master.rig import Rig

pytestmark = pytest.mark.slow  # one compiles for a minute


def run(code, folder):
    return subprocess.run(
        [sys.executable, "-c", f"from skinbus.skin.compile_ahead import *; {code}"],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip


def test_compiling_is_done_once_and_goes_on_when_who_asked_for_it_has_ended(tmp_path):
    ask = "import os; print(first_level('fit'), *(start_compiling().pid for _ in range(2)), flush=True)"
    available, *pids = run(f"{ask}; os._exit(0)", tmp_path).stdout.split()  # as one that is killed
    assert available == "kmeans"
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids), 0.1)
    assert run("print(first_level('fit'))", tmp_path).stdout.strip() == "fit"


def test_without_a_place_for_kernels_the_level_is_the_one_asked_for(tmp_path):
    (tmp_path / "file").touch()
    assert run("print(first_level('full'))", tmp_path / "file").stdout.strip() == "full"


def test_level_that_is_compiled_while_the_master_runs_is_used_from_then_on(monkeypatch):
    monkeypatch.setattr(compile_ahead, "is_kept", lambda level: level == "fit")
    monkeypatch.setattr(compile_ahead, "WARM", (sys.executable, "-c", ""))
    rig = Rig("pad", level="fit", available="kmeans")
    reports, _, _ = rig.run(3000)
    assert {report.level for report in reports} == {"kmeans"}
    compile_ahead.allow_when_compiled(rig.master, "fit", compile_ahead.start_compiling())
    for thread in threading.enumerate():
        if thread.name == "skinbus-compile":
            thread.join(PATIENCE_S)
    assert rig.run(2000)[0][-1].level == "fit"
