"""`skinbus doctor warm` and the end of a command while it compiles."""

import os
import signal
import subprocess
import sys
import time

import pytest

from skinbus.jit.kernel_files import KernelFolder
from tests.cli.patience import PATIENCE_S


def start(folder):
    """`skinbus doctor warm` with an empty cache."""
    return subprocess.Popen(
        [sys.executable, "-m", "skinbus", "doctor", "warm"],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.slow
def test_sigterm_while_kernels_are_compiled_ends_it_cleanly_and_keeps_what_is_compiled(tmp_path):
    process = start(tmp_path)
    folder = None
    while folder is None or not list(folder.names()):
        assert process.poll() is None
        time.sleep(0.1)
        found = list(tmp_path.glob("kernels-*"))
        folder = KernelFolder(found[0]) if found else None
    process.send_signal(signal.SIGTERM)
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in output + errors
    assert errors.strip() == "Aborted!"
    assert process.returncode == 1
    assert all(folder.load(name) for name in folder.names())
