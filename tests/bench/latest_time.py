"""Measures latest() of shared memory: python -m tests.bench.latest_time [TIMES]

A process writes cycles of the forearm, 24 patches and 0 to 64 contacts, at 50 Hz; the loop of
``docs/examples/control_loop.py`` at 1 kHz reads them in this one and prints its figures.
"""

import secrets
import subprocess
import sys
from pathlib import Path

from skinbus.skin.shared_object import path_of

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "control_loop.py"
PERIOD_S = "0.02"


def main(times=3):
    """Measure and print."""
    name = f"bench-{secrets.token_hex(4)}"
    write = [sys.executable, "-m", "tests.skin.shared_processes", "write", name, PERIOD_S]
    with subprocess.Popen(write, stdout=subprocess.PIPE) as writer:
        writer.stdout.readline()
        text = EXAMPLE.read_text().replace('attach("arm")', f'attach("{name}")')
        for _ in range(times):
            exec(compile(text, EXAMPLE, "exec"), {})
        writer.kill()
    path_of(name).unlink()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
