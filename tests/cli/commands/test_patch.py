"""`skinbus patch`: the example as a process on a bus, and words that name no function."""

import pytest

from tests.cli.commands.on_bus import passed_rows
from tests.cli.invoke import run
from tests.test_examples import EXAMPLES


@pytest.mark.slow
def test_example_reader_passes_the_check_of_boards(skinbus, group, monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    bus = ["--interface", "udp_multicast", "-c", group]
    patch = skinbus("patch", "skin-patch", "--reader", "made_up_pad:read", "--node", "5", *bus)
    assert "node 5 of 16 tactels" in patch.stdout.readline()
    # a loaded process in Python is no firmware: what is asked of its timing is little
    words = ["board", "check", "--node", "5", "--response-ms", "200", "--syncs", "50", *bus]
    answer = run(*words, status=None)
    rows = passed_rows(answer)
    assert [["pass", name] in rows for name in ("channels", "at", "EMCY")] == [True] * 3, answer
