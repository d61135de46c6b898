"""Calibration: from a table of presses at known places to the response of boards, and where these sit.

:mod:`.table` holds presses, :mod:`.gate` judges them and learns from them, :mod:`.learning` and
:mod:`.residual_map` say how, :mod:`.validation` what error is to be expected. :mod:`.recording` finds presses
in a recording, :mod:`.location` boards.
"""
