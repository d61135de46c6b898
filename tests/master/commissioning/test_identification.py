"""Who sits where is found by pressing; no guess is made."""

import tomllib

import pytest

from skinbus.config.arm_edit import edit_arm
from skinbus.config.arm_file import check_tables, find_arm
from skinbus.master.commissioning.identification import Identified
from skinbus.master.commissioning.unplaced_boards import changes_of
from tests.master.commissioning.story import SEED, Story


def test_boards_in_random_order_are_all_found():
    story = Story()
    n_presses = 0
    while not story.dialogue.is_over:
        story.obey()
        n_presses += 1
    assert len(story.dialogue.found) == 24
    assert n_presses == 24
    story.check()


def test_what_was_found_goes_into_the_arm_file(tmp_path):
    story = Story(name="pad", seed=SEED + 10)
    story.one_place()
    path = find_arm("pad")
    changes = changes_of(story.mountings, story.dialogue.found)
    (after,) = check_tables(tomllib.loads(edit_arm(path, path.read_text(), changes)), path).mountings
    (own,) = story.dialogue.found.values()
    assert (after.board.node_id, after.board.serial) == (own.node_id, own.serial)


WRONG = {
    "two boards": lambda story: story.press(story.person.point(0), story.person.point(11)),
    "too light": lambda story: story.press(story.person.aim(story.lines[-1]), force=0.65),
    "too short": lambda story: story.press(story.person.aim(story.lines[-1]), seconds=0.15),
    "off the place": lambda story: story.press(story.person.point(1, off=(0.018, 0.018))),
    "the same board again": lambda story: story.press(story.person.point(0)),
    "a stuck board": lambda story: story.press(story.person.point(5), seconds=10.5),
}
SAID = {
    "two boards": "More than one board",
    "too light": "too lightly",
    "too short": "too shortly",
    "off the place": "mm from its centre",
    "the same board again": "which is at forearm, s 26 mm, angle 0 deg",
    "a stuck board": "what it reads now is its zero",
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_press_is_named_and_changes_nothing(kind):
    story = Story()
    story.one_place()
    lines = WRONG[kind](story)
    assert SAID[kind] in " ".join(lines)
    assert len(story.dialogue.found) == 1
    story.one_place()
    story.check()


def test_undo_skip_and_words_that_are_none():
    story = Story()
    assert "nothing to take back" in " ".join(story.wait(0.1, "undo"))
    story.obey()
    assert "Taken back" in " ".join(story.wait(0.1, "undo"))
    assert "Left out" in " ".join(story.wait(0.1, "skip"))
    assert "angle 45 deg: press the centre" in story.lines[-1]
    story.one_place()
    assert "is no answer" in " ".join(story.wait(0.1, "maybe\x1b"))
    assert "\x1b" not in " ".join(story.lines)
    story.wait(0.1, "quit")
    assert story.dialogue.is_over
    assert story.dialogue.is_quit


def mountings_of(*tables):
    link = {"name": "l", "surface": "plane", "length_mm": 900, "width_mm": 90}
    patches = [{"link": "l", "s_mm": 40.0 + 60.0 * k, **table} for k, table in enumerate(tables)]
    document = {"arm": {"name": "x"}, "link": [link], "patch": patches}
    return check_tables(document, find_arm("pad")).mountings


def test_the_file_of_a_calibrated_board_goes_where_the_board_is():
    mountings = mountings_of(
        {"node_id": 1, "eds": "one.dcf"},
        {"node_id": 2, "eds": "two.dcf"},
        {"node_id": 3, "eds": "x", "serial": 9},
    )
    keys = [m.key for m in mountings]
    found = {
        keys[0]: Identified(3, 9),
        keys[1]: Identified(1, 7),
        keys[2]: Identified(2, 8),
    }
    changes = changes_of(mountings, found)
    assert [changes[key]["eds"] for key in keys] == ["x", "one.dcf", "two.dcf"]


def test_a_place_without_a_board_gives_its_node_id_up():
    mountings = mountings_of({"node_id": 1}, {"node_id": 2}, {"node_id": 3})
    keys = [m.key for m in mountings]
    found = {keys[0]: Identified(2, 0), keys[2]: Identified(3, 0)}
    assert changes_of(mountings, found) == {keys[0]: {"node_id": 2}, keys[1]: {"node_id": 1}}
