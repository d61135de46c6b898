"""The text of an EDS or DCF, changed line by line: all else stays as it is."""

from __future__ import annotations

import re


class EdsText:
    """Lines by section (name in lower case); the first line of a section is its heading."""

    def __init__(self, text: str) -> None:
        self._newline = "\r\n" if "\r\n" in text else "\n"
        self.sections: dict[str, list[str]] = {"": []}
        name = ""
        for line in text.splitlines():
            if heading := re.match(r"\s*\[\s*(.*?)\s*\]", line):
                name = heading[1].lower()
            self.sections.setdefault(name, []).append(line)

    def put(self, section: str, key: str, value: object) -> None:
        """Replace the value of a key, or add the key behind the last one of its section."""
        lines = self.sections.setdefault(section.lower(), ["", f"[{section}]"])
        last = 0
        for k, line in enumerate(lines):
            name = line.partition("=")[0].strip()
            if name.lower() == key.lower():
                lines[k] = f"{name}={value}"
                return
            if name and not name.startswith((";", "#")):
                last = k
        lines.insert(last + 1, f"{key}={value}")

    def put_listed(self, section: str, key: str, value: object) -> None:
        """Put a key into a section that counts its keys."""
        self.put(section, key, value)
        numbered = [line for line in self.sections[section.lower()] if line[:1].isdigit()]
        self.put(section, "NrOfEntries", len(numbered))

    def list_objects(self, section: str, indices: list[str]) -> None:
        """Make a section list these objects."""
        lines = [f"[{section}]", f"SupportedObjects={len(indices)}"]
        self.sections[section.lower()] = [*lines, *(f"{k}=0x{i}" for k, i in enumerate(indices, 1)), ""]

    def text(self) -> str:
        """Return the text."""
        return self._newline.join(line for lines in self.sections.values() for line in lines) + self._newline
