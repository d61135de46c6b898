"""The master: boots and supervises patches, gathers a cycle, estimates, publishes contacts."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skinbus.master.cycle_report import CycleReport
    from skinbus.master.master import Master

__all__ = ["CycleReport", "Master"]

# Loaded at first use: who reads a state or a flag needs no master.
_HOME = {
    "CycleReport": "skinbus.master.cycle_report",
    "Master": "skinbus.master.master",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'skinbus.master' has no attribute {name!r}")
