"""Types of records: what kernels keep of each tactel, board or track in one array."""

from __future__ import annotations

from typing import Any

import numpy as np


def record(columns: dict[str, str]) -> np.dtype[Any]:
    """Return the type of records with these columns: kinds, as numpy names them, and names by spaces.

    A kernel reads ``rows[i].name``, compiled or not; Python ``rows["name"]``.
    """
    fields = [(name, kind) for kind, names in columns.items() for name in names.split()]
    return np.dtype((np.record, np.dtype(fields, align=True)))
