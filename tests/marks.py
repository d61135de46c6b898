"""Marks and parameters that tests share."""

import pytest

from skinbus.estimate import LEVELS

levels = pytest.mark.parametrize("level", LEVELS)
fits = pytest.mark.parametrize("level", ["fit", "full"])


def slow(*rows):
    """Mark rows, which are tuples where there are several parameters, as slow."""
    return [pytest.param(*row if isinstance(row, tuple) else [row], marks=pytest.mark.slow) for row in rows]
