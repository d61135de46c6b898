"""`skinbus board check` against a simulated board."""

import pytest

from skinbus.config.system import load_arm
from skinbus.sim import World
from tests.cli.commands.on_bus import passed_rows
from tests.master.commissioning.person import pressed_scene


@pytest.mark.slow
def test_simulated_board_passes_and_a_node_that_is_not_there_is_said(own_bus):
    with own_bus.with_cores(World(pressed_scene(load_arm("pad")))):
        # a loaded process in Python is no firmware: what is asked of its timing is little
        answer = own_bus.run(
            "board", "check", "--node", "1", "--response-ms", "200", "--syncs", "50", status=None
        )
        absent = own_bus.run("board", "check", "--node", "77", status=1)
    rows = passed_rows(answer)
    assert ["skipped", "storage"] in rows
    assert "pass    identity" in answer
    assert "no node 77" in absent
