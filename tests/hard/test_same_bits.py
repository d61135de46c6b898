"""The same inputs give the same bits on every run, the same numbers uncompiled, where indices are checked.

Uncompiled, numpy sums and libm's functions may round the last bit otherwise; a fit carries that into its
answer, so places, forces and covariances agree to 1e-12 relative to the largest number of their column.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent.parent
ALIKE = 1e-12


def run(**environment):
    """Return what the kernels make of the inputs, in a process of their own."""
    command = [sys.executable, "-W", "error", "-m", "tests.hard.bits"]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return {name: [float.fromhex(v) for v in values] for name, values in json.loads(done.stdout).items()}


@pytest.mark.slow  # in small: test_budget_in_work_gives_the_same_bits_every_time
def test_every_run_gives_the_same_bits_and_uncompiled_the_same_numbers():
    compiled, again, plain = run(), run(), run(NUMBA_DISABLE_JIT="1")
    assert sum(map(len, compiled.values())) > 1000
    assert compiled.keys() == again.keys() == plain.keys()
    for name, want in compiled.items():
        assert np.array_equal(want, again[name], equal_nan=True), name
        scale = np.abs(want).max(initial=0.0)
        assert np.allclose(plain[name], want, rtol=ALIKE, atol=ALIKE * scale), name
