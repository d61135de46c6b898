"""The pages on commissioning and calibration show what their commands print."""

import pytest

from tests.commissioning_page import DOCS, marks, outputs


@pytest.mark.slow
def test_outputs_on_the_pages_are_those_of_the_commands():
    for (page, name), text in outputs().items():
        assert text in marks(name).read(DOCS / page), f"{name}: run python -m tests.commissioning_page"
