"""Where a device keeps its stored parameters: one JSON file, replaced as a whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path


class ParameterFile:
    """A storage (see ``node.storage``) in a file; a file that is not there holds nothing.

    A damaged file is a ValueError when it is loaded; saving to it or erasing begins a new one.
    A file that cannot be read or written is an OSError.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def load(self, group: str) -> str | None:
        """What was saved for a group; None when nothing was."""
        return self._read().get(group)

    def save(self, group: str, text: str) -> None:
        """Keep the text of a group in place of what was there."""
        self._write({**self._what_is_left(), group: text})

    def erase(self, group: str) -> None:
        """Forget a group."""
        groups = self._what_is_left()
        groups.pop(group, None)
        self._write(groups)

    def _read(self) -> dict[str, str]:
        try:
            groups = json.loads(self.path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}
        if not isinstance(groups, dict) or not all(isinstance(text, str) for text in groups.values()):
            raise ValueError(f"{self.path}: wanted an object of texts by group")
        return groups

    def _what_is_left(self) -> dict[str, str]:
        try:
            return self._read()
        except ValueError:
            return {}

    def _write(self, groups: dict[str, str]) -> None:
        """Write beside it, then put it in place: a power cut leaves the old or the new file."""
        new = self.path.with_name(f"{self.path.name}.new")
        with new.open("w", encoding="utf-8") as file:
            json.dump(groups, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        new.replace(self.path)
