"""The page on commissioning shows what its commands print."""

from tests.commissioning_page import PAGE, marks, outputs


def test_outputs_on_the_page_are_those_of_the_commands():
    for name, text in outputs().items():
        assert text in marks(name).read(PAGE), f"{name}: run python -m tests.commissioning_page"
