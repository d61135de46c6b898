"""Calibration: from a table of presses at known places to the response of boards, and where these sit.

:mod:`.table` holds presses, :mod:`.gate` judges them and learns from them, :mod:`.learning` and
:mod:`.response` say how, :mod:`.validation` what error is to be expected.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbus.lazy import at_first_use

if TYPE_CHECKING:
    from skinbus.estimate.calibration.gate import Judgement, judge
    from skinbus.estimate.calibration.learning import Calibration, learn_radial_law
    from skinbus.estimate.calibration.table import PressTable

__all__ = ["Calibration", "Judgement", "PressTable", "judge", "learn_radial_law"]

_HOME = {
    "Calibration": "skinbus.estimate.calibration.learning",
    "Judgement": "skinbus.estimate.calibration.gate",
    "PressTable": "skinbus.estimate.calibration.table",
    "judge": "skinbus.estimate.calibration.gate",
    "learn_radial_law": "skinbus.estimate.calibration.learning",
}
__getattr__ = at_first_use(__name__, _HOME)
