"""Handles of the rig: interfaces made, taken down and removed."""

import subprocess


def ip(*words):
    """Run ip(8)."""
    subprocess.run(["ip", *words], check=True, capture_output=True)
