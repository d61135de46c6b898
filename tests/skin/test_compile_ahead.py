"""Another process compiles what `fit` needs, once, to its end; the master runs at `kmeans` meanwhile."""

import os
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from skinbus.skin import compile_ahead
from skinbus.skin.compile_ahead import Raising
from tests.cli.patience import PATIENCE_S
from tests.master.rig import Rig


def run(code, folder):
    return subprocess.run(
        [sys.executable, "-c", f"from skinbus.skin.compile_ahead import *; {code}"],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip


@pytest.mark.slow  # compiles for a minute
def test_compiling_is_done_once_and_goes_on_when_who_asked_for_it_has_ended(tmp_path):
    ask = "import os; asked = [Raising('fit') for _ in range(2)]; print(asked[0].available, flush=True)"
    ask += "; print(*(one._process.pid for one in asked), flush=True); os._exit(0)"  # as one that is killed
    done = run(ask, tmp_path)
    available, pids = done.stdout.splitlines()
    assert available == "kmeans", done.stderr
    end = time.monotonic() + PATIENCE_S
    while any(Path(f"/proc/{pid}").exists() for pid in pids.split()):
        assert time.monotonic() < end
        time.sleep(0.1)  # between two looks at other processes
    assert run("print(is_kept('fit'))", tmp_path).stdout.strip() == "True"


def test_without_a_place_for_kernels_no_process_is_started(tmp_path):
    (tmp_path / "file").touch()
    done = run("one = Raising('full'); print(one.available, one._process)", tmp_path / "file")
    assert done.stdout.split() == ["full", "None"], done.stderr


def test_level_that_is_compiled_while_the_master_runs_is_used_from_then_on(monkeypatch):
    kept = iter([False, True])
    monkeypatch.setattr(compile_ahead, "is_kept", lambda level: next(kept))
    monkeypatch.setattr(compile_ahead, "WARM", (sys.executable, "-c", ""))
    with closing(Raising("fit")) as raising:
        rig = Rig("pad", level="fit", available=raising.available)
        reports, _, _ = rig.run(3000)
        assert {report.level for report in reports} == {"kmeans"}
        raising.start(rig.master)
        raising._thread.join(PATIENCE_S)
        assert rig.run(500)[0][-1].level == "fit"
