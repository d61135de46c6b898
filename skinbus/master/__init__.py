"""The master: boots and supervises patches, gathers a cycle, estimates, publishes contacts."""

from skinbus.master.master import CycleReport, Master

__all__ = ["CycleReport", "Master"]
