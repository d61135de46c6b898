"""Lint of EDS and DCF files: everything that reading does not notice and ``dcfchk`` lets pass."""

from __future__ import annotations

from skinbus.errors import Fault
from skinbus.objects.eds_file import EdsFile


def lint(file: EdsFile) -> list[Fault]:
    """Return every fault of a file, those of its reading first."""
    return list(file.faults)
