"""A state file that a command keeps while its master runs, and what it says of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from skinbus.config.state_file import StateFile


class KeptFile:
    """A file of tables; ``say`` reports its faults, each line after ``name``."""

    def __init__(self, file: StateFile, name: str, say: Callable[[str], Any]) -> None:
        self._file = file
        self._name = name
        self._say = say
        self._is_faulty = False

    @property
    def faults(self) -> list[str]:
        """What was wrong when it was loaded."""
        return self._file.faults

    def load(self) -> dict[str, Any] | None:
        """Return the tables, None if none are whole; say what is wrong."""
        tables = self._file.load()
        for fault in self._file.faults:
            self._say(f"{self._name}: {fault}")
        return tables

    def save(self, tables: dict[str, Any]) -> bool:
        """Write tables and return whether they are; the first of several failures is said."""
        try:
            self._file.save(tables)
        except OSError as error:
            if not self._is_faulty:
                self._say(f"{self._name}: cannot be written: {error}")
            self._is_faulty = True
            return False
        self._is_faulty = False
        return True
