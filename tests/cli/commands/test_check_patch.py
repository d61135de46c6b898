"""`skinbus board check` against a simulated board."""

import json

import pytest

from skinbus.sim import World, load_scene


@pytest.mark.slow
def test_simulated_board_passes_and_a_node_that_is_not_there_is_said(own_bus, tmp_path):
    file = tmp_path / "rules.json"
    with own_bus.with_cores(World(load_scene("pad"))):
        # a loaded process in Python is no firmware: what is asked of its timing is little
        answer = own_bus.run("board", "check", "--node", "1", "--response-ms", "200", "--json", file)
        absent = own_bus.run("board", "check", "--node", "77")
    rows = {row["rule"]: row for row in json.loads(file.read_text())["rules"]}
    slow = {"heartbeat", "readings"}  # these fail when the machine is too busy for them
    assert {name for name, row in rows.items() if row["grade"] == "fail"} <= slow, answer.output
    assert rows["storage"]["grade"] == "skipped"
    assert "pass    identity" in answer.output
    assert (absent.exit_code, "no node 77" in absent.output) == (1, True)
