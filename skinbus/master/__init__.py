"""The master: boots and supervises patches, gathers a cycle, estimates, publishes contacts."""

from skinbus.master.cycle_report import CycleReport
from skinbus.master.master import Master

__all__ = ["CycleReport", "Master"]
