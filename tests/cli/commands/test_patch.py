"""`skinbus patch` and `skinbus board check`: the example as a process on a bus."""

import pytest

from tests.cli.commands.on_bus import passed_rows
from tests.cli.invoke import run
from tests.test_examples import EXAMPLES


def test_patch_without_readings_at_the_end_says_so_by_its_status(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "silent_pad.py").write_text("import threading\nread = threading.Event().wait\n")
    words = ["skin-patch", "--node", "5", "--interface", "virtual", "--seconds", "0.3"]
    assert "hangs" in run("patch", *words, "--reader", "silent_pad:read", status=1)
    assert "no readings" not in run("patch", *words, "--reader", "tests.cli.commands.test_patch:read")


def read():
    return [0] * 16


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
    wanted = [["pass", name] for name in ("identity", "channels", "at", "EMCY")] + [["skipped", "storage"]]
    assert all(row in rows for row in wanted), answer
    assert "no node 77" in run("board", "check", "--node", "77", *bus, status=1)
