"""`skinbus scan identify` on a bus: a hand presses, the arm file is written."""

import pytest

from skinbus.config.arm_file import find_arm, read_arm_file
from tests.cli.commands.pressed_pad import pressed_pad
from tests.cli.patience import until_in_time
from tests.files import put


def in_time(said):
    """Return what is said when the board was not held up."""
    return until_in_time(said, lambda said: "answered no SDO request" not in said)


@pytest.fixture
def file(tmp_path):
    return put(tmp_path, "my-arm.toml", "# mine\n" + find_arm("pad").read_text())


@pytest.mark.slow
def test_a_board_is_found_by_a_press_and_goes_into_the_file(own_bus, file):
    with pressed_pad(own_bus) as (arm, hand):
        hand.start()
        said = in_time(lambda: own_bus.run("scan", "identify", file, status=None))
    assert "press the centre" in said
    (after,) = read_arm_file(file).mountings
    assert (after.board.node_id, after.board.serial) == (arm.node_id[0], arm.patches[0].serial)
    assert file.read_text().startswith("# mine\n")
    assert [path.name for path in file.parent.iterdir()] == ["my-arm.toml"]


def test_quit_writes_nothing(own_bus, file):
    before = file.read_text()
    with pressed_pad(own_bus):
        own_bus.run("scan", "identify", file, text="quit\n", status=1)
    assert file.read_text() == before


def test_a_bus_without_boards_is_said_before_anything_is_pressed(own_bus, file):
    assert "no node answers" in own_bus.run("scan", "identify", file, status=1)


def test_boards_that_the_arm_file_does_not_have_are_named(own_bus, file):
    file.write_text(file.read_text().replace('"skin-patch"', '"skin-patch-8bit"'))
    with pressed_pad(own_bus):
        said = in_time(lambda: own_bus.run("scan", "identify", file, status=1))
    assert "of no kind that the arm file has" in said
    assert "no node answers" not in said
