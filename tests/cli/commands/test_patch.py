"""`skinbus patch`: the example as a process on a bus, and words that name no function."""

import pytest
from click.testing import CliRunner

from skinbus.cli import group as cli
from tests.cli.commands.on_bus import passed_rows
from tests.test_examples import EXAMPLES


@pytest.mark.slow
def test_example_reader_passes_the_check_of_boards(skinbus, group, monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    bus = ["--interface", "udp_multicast", "-c", group]
    patch = skinbus("patch", "skin-patch", "--reader", "made_up_pad:read", "--node", "5", *bus)
    assert "node 5 of 16 tactels" in patch.stdout.readline()
    # a loaded process in Python is no firmware: what is asked of its timing is little
    words = ["board", "check", "--node", "5", "--response-ms", "200", "--syncs", "50", *bus]
    answer = CliRunner().invoke(cli, words)
    rows = passed_rows(answer.output)
    assert [["pass", name] in rows for name in ("channels", "at", "EMCY")] == [True] * 3, answer.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("made_up_pad", "wanted MODULE:FUNCTION"),
        ("no_such_module:read", "No module named 'no_such_module'"),
        ("math:no_such_function", "no_such_function"),
        ("math:pi", "math:pi is of type float; wanted a function"),
    ],
)
def test_words_that_name_no_function_are_refused(words, said):
    answer = CliRunner().invoke(cli, ["patch", "skin-patch", "--node", "5", "--reader", words])
    assert answer.exit_code == 2
    assert said in " ".join(answer.output.split())
