"""What a master has learned, in one file that outlives a loss of power: whole generations, checked when read.

A file is a line ``skinbus-state VERSION SHA256 BYTES`` and that many bytes of JSON. It is written beside the
last one, flushed to the disk and put in its place; the one before stays as ``NAME.1`` and is read if the
newest is not whole. It is no database: one writer replaces all of it, and any tool can read it.
"""

from __future__ import annotations

import glob
import hashlib
import json
import math
import os
from pathlib import Path
from typing import Any

from skinbus.errors import ConfigError
from skinbus.file_bytes import read_bytes, write_whole

VERSION = 1
MAX_BYTES = 16 << 20
"""An arm of 16 buses with 126 patches of 64 tactels has half of this."""

MAGIC = "skinbus-state"
"""First word of a file."""


class StateFile:
    """The two newest generations of a state; ``faults`` says why one could not be read."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.before = self.path.with_name(self.path.name + ".1")
        """The generation before the newest."""
        self.faults: list[str] = []

    def load(self) -> dict[str, Any] | None:
        """Return the newest whole state, None without one; nothing in a file raises.

        What writers that were killed have left unfinished is removed.
        """
        self.faults = []
        for unfinished in self.path.parent.glob(f".{glob.escape(self.path.name)}.*.tmp"):
            unfinished.unlink(missing_ok=True)
        for path in (self.path, self.before):
            if not os.path.lexists(path):
                continue
            try:
                return _parse(read_bytes(path, MAX_BYTES))
            except (ConfigError, ValueError, RecursionError) as error:
                what = error.faults[0] if isinstance(error, ConfigError) else error
                self.faults.append(f"{path}: {what}")
        return None

    def save(self, state: dict[str, Any]) -> None:
        """Write a new generation; when this returns it outlives a loss of power.

        Raises:
            OSError: it cannot be written; the last generations are as they were.
        """
        write_whole(self.path, _spell(state), 0o600, self.before)
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _spell(state: dict[str, Any]) -> bytes:
    # A piece at a time: the encoder of json holds all other threads up, the one with the cycle too.
    pieces = [f"{json.dumps(key)}: {_piece(value)}" for key, value in state.items()]
    body = ("{" + ",\n".join(pieces) + "}\n").encode()
    return f"{MAGIC} {VERSION} {hashlib.sha256(body).hexdigest()} {len(body)}\n".encode() + body


def _piece(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ",\n ".join(f"{json.dumps(key)}: {json.dumps(own)}" for key, own in value.items()) + "}"
    return json.dumps(value)


def _parse(content: bytes) -> dict[str, Any]:
    """Return the state in a file; ValueError says why it is none."""
    head, _, body = content.partition(b"\n")
    words = head.decode("ascii", errors="replace").split()
    if len(words) != 4 or words[0] != MAGIC:
        raise ValueError("no state of skinbus")
    if words[1] != str(VERSION):
        raise ValueError(f"version {words[1][:20]!r}; this skinbus reads {VERSION}")
    if words[3] != str(len(body)) or words[2] != hashlib.sha256(body).hexdigest():
        raise ValueError("damaged: it is not what was written")
    state = json.loads(body, parse_constant=lambda word: math.nan)
    if not isinstance(state, dict):
        raise ValueError("no table")
    return state
