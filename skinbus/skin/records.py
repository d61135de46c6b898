"""Contacts and patches of a cycle as records: what shared memory holds, see ``docs/shared-memory.md``."""

from __future__ import annotations

import numpy as np

CONTACT = np.dtype(
    [
        ("identity", "<i8"),
        ("seen_ns", "<i8"),
        *[(name, "<u4") for name in ("id", "link", "state", "quality", "level", "has_covariance")],
        *[(name, "<f8") for name in ("s", "a", "force")],
        ("point", "<f8", 3),
        ("normal", "<f8", 3),
        ("covariance", "<f8", (3, 3)),
    ]
)
"""A contact as a record of 184 bytes."""

PATCH = np.dtype([("last_fresh_ns", "<i8"), ("state", "<u4"), ("emcy", "<u4")])
"""The state of a patch as a record of 16 bytes."""

UNKNOWN_LEVEL = 255
"""Level of a record of which neither level nor quality is known."""
