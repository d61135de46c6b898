"""The whole table of hard cases."""

from __future__ import annotations

from typing import Final

from skinbus.study.hard.boards import BOARDS
from skinbus.study.hard.check import Case
from skinbus.study.hard.places import LAW, WHERE
from skinbus.study.hard.readings import READINGS

CASES: Final[tuple[Case, ...]] = (*READINGS, *WHERE, *LAW, *BOARDS)
"""Every case, in the order of the table."""
