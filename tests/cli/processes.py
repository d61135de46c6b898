"""Commands run as processes of their own, to their very end."""

import subprocess
import sys


def process(*args, **settings):
    """Run a command as a process of its own, to its very end."""
    settings = {"stdout": subprocess.PIPE} | settings
    return subprocess.run(
        [sys.executable, "-m", "skinbus", *args], stderr=subprocess.PIPE, text=True, check=False, **settings
    )
