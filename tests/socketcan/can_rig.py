"""Handles of the rig: interfaces made, taken down and removed."""

import subprocess
from pathlib import Path

EDS = Path(__file__).parents[2] / "eds"


def ip(*words):
    """Run ip(8)."""
    subprocess.run(["ip", *words], check=True, capture_output=True)
