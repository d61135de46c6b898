"""The master: boots and supervises patches, gathers a cycle, estimates, publishes contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbus.lazy import at_first_use

if TYPE_CHECKING:
    from skinbus.master.cycle import CycleReport
    from skinbus.master.master import Master

__all__ = ["CycleReport", "Master"]

# A state or a flag is read without a master.
_HOME = {
    "CycleReport": "skinbus.master.cycle",
    "Master": "skinbus.master.master",
}
__getattr__ = at_first_use(__name__, _HOME)
