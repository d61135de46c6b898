"""Commands in this process: what they say, and why they refuse."""

from click.testing import CliRunner

from skinbus.cli import group
from skinbus.errors import SkinbusError


def run(*words, status=0, text=""):
    """Run a command that ends with a status (None: any); return all that it says."""
    result = CliRunner().invoke(group, [*map(str, words)], input=text)
    assert status in (None, result.exit_code), (result.output, result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result.output


def refused(*words):
    """Run a command that refuses what it is given; return why. Errors of files are told by ``main``."""
    result = CliRunner().invoke(group, [*map(str, words)])
    assert result.exit_code == 2 or isinstance(result.exception, SkinbusError), result.output
    return " ".join(f"{result.output} {result.exception}".split())
