"""Presses at known places: whether a calibration may be made of them, and how good it will be."""

from skinbus.estimate.presses.gate import GateFinding, Judgement, judge
from skinbus.estimate.presses.table import PressTable

__all__ = ["GateFinding", "Judgement", "PressTable", "judge"]
