"""The command line as a stranger meets it."""

import pytest

from skinbus import estimate
from skinbus.cli import COMMANDS, SUBCOMMANDS, options
from tests.cli.invoke import run
from tests.run_in_process import run_code


def test_help_lists_every_command():
    said = run("--help")
    for name in COMMANDS:
        assert name in said


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from click.testing import CliRunner; from skinbus.cli import group;"
        "CliRunner().invoke(group, ['--help']);"
        "heavy = ('numpy', 'numba', 'scipy', 'can', 'canopen', 'rich', 'pydantic');"
        "print([m for m in heavy if m in sys.modules])"
    )
    assert run_code(code) == "[]"


def test_levels_of_the_command_line_are_those_of_the_estimator():
    assert options.LEVELS == estimate.LEVELS
    assert options.DEFAULT_LEVEL == estimate.DEFAULT_LEVEL


BELOW = [f"{name} {sub}" for name, subs in SUBCOMMANDS.items() for sub in subs]
OF_BOARD = [f"board {sub}" for sub in ("new", "lint", "firmware", "check")]


@pytest.mark.parametrize("name", [*COMMANDS, *BELOW, *OF_BOARD])
def test_every_command_has_help_with_an_example(name):
    said = run(*name.split(), "--help")
    assert f"skinbus {name}" in said.partition("xample")[2]
    for sub in SUBCOMMANDS.get(name, ()):
        assert f"skinbus {name} {sub}" in said
