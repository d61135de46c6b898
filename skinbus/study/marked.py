"""Pages of which a command writes the part between two marks."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from skinbus.errors import ConfigError, Fault


class Marks(NamedTuple):
    """The lines between which a command writes."""

    begin: str
    end: str

    def read(self, page: Path) -> str:
        """Return the text of a page with these marks.

        Raises:
            ConfigError: it has none.
        """
        text = page.read_text(encoding="utf-8")
        if self.begin not in text or self.end not in text:
            raise ConfigError(str(page), [Fault("marks", None, f"lines {self.begin!r} and {self.end!r}")])
        return text

    def write(self, page: Path, between: str) -> None:
        """Replace what stands between the marks of a page.

        Raises:
            ConfigError: the page has no such marks.
        """
        before, rest = self.read(page).split(self.begin, 1)
        after = rest.split(self.end, 1)[1]
        page.write_text(f"{before}{self.begin}\n\n{between}\n{self.end}{after}", encoding="utf-8")
