"""A process that saves without a pause is killed at random: what it leaves is always a whole state."""

import random
import subprocess
import sys
import time
from pathlib import Path

from skinbus.config.state_file import StateFile

WRITER = """
import sys
from skinbus.config.state_file import StateFile
file = StateFile(sys.argv[1])
state = file.load() or {"n": 0}
ready = "ready"
while True:
    patches = {str(k): {"zero_Pa": [float(state["n"])] * 16} for k in range(24)}
    state = {"n": state["n"] + 1, "patches": patches}
    file.save(state)
    if ready:
        print(ready, flush=True)
        ready = ""
"""


def kill_often(n, seed, folder):
    """Kill a writer ``n`` times; return how many saves there were, and fail on a state that is not whole."""
    rng = random.Random(seed)
    file = StateFile(Path(folder) / "state")
    last = 0
    for k in range(n):
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(file.path)], stdout=subprocess.PIPE
        ) as writer:
            writer.stdout.readline()
            time.sleep(rng.uniform(0.0, 0.05))
            writer.kill()
        state = file.load()
        assert state is not None, f"seed {seed}, kill {k}: {file.faults}"
        assert state["n"] >= last, f"seed {seed}, kill {k}: went back from {last} to {state['n']}"
        assert all(own["zero_Pa"] == [float(state["n"] - 1)] * 16 for own in state["patches"].values())
        last = state["n"]
    return last
