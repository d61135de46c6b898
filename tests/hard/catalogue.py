"""The whole table of hard cases."""

from __future__ import annotations

from typing import Final

from tests.hard.boards import BOARDS
from tests.hard.check import Case
from tests.hard.places import LAW, WHERE
from tests.hard.readings import READINGS

CASES: Final[tuple[Case, ...]] = (*READINGS, *WHERE, *LAW, *BOARDS)
"""Every case, in the order of the table."""
