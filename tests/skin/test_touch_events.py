"""Each touch, motion and lift is an event once, whatever the source says of states and identities."""

from pathlib import Path

import pytest

import skinbus
from skinbus.estimate import TrackState
from skinbus.skin.skin import TouchEvents
from tests.skin.scenes import write
from tests.skin.scripted import scripted


def events_of(*cycles):
    """The events of cycles as (number, kind, id)."""
    finder = TouchEvents()
    made = [scripted(number, *contacts) for number, contacts in enumerate(cycles, 1)]
    return [(cycle.number, kind, contact.id) for cycle in made for kind, contact in finder.step(cycle)]


def test_a_contact_is_touched_moves_and_lifts_once():
    life = [[(3, state)] for state in ("TOUCH", "HELD", "MOVE", "MOVE", "COAST", "HELD", "MOVE", "LIFT")]
    assert events_of(*life, []) == [(1, "touch", 3), (3, "move", 3), (7, "move", 3), (8, "lift", 3)]


def test_events_survive_lost_cycles():
    """Neither the first cycle of a contact nor its last has to be seen."""
    assert events_of([(3, "HELD")], [(4, "MOVE")], []) == [
        (1, "touch", 3),
        (2, "lift", 3),
        (2, "touch", 4),
        (2, "move", 4),
        (3, "lift", 4),
    ]


def test_an_id_that_is_given_again_is_another_contact():
    """By its identity, or where there is none by its state."""
    assert events_of([(3, "HELD", 7)], [(3, "HELD", 8)]) == [(1, "touch", 3), (2, "lift", 3), (2, "touch", 3)]
    assert events_of([(3, "HELD")], [(3, "TOUCH")]) == [(1, "touch", 3), (2, "lift", 3), (2, "touch", 3)]


def test_a_contact_that_waits_for_a_slot_is_touched_once():
    """Its state is TOUCH again when it gets one."""
    assert events_of([(3, "TOUCH", 7)], [(3, "HELD", 7)], [(3, "TOUCH", 7)]) == [(1, "touch", 3)]


def test_what_has_lifted_has_no_force():
    finder = TouchEvents()
    finder.step(scripted(1, (3, "HELD")))
    ((kind, contact),) = finder.step(scripted(2))
    assert (kind, contact.state, contact.force) == ("lift", TrackState.LIFT, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("silence", "kinds"),
    [
        ("from_s = 0.6", ["touch", "lost"]),  # pressed when its board stops, and for half a second more
        ("from_s = 0.9\nto_s = 1.0", ["touch", "lift"]),  # the board is back before the contact has ended
        ("from_s = 1.3", ["touch", "lift"]),  # released before
    ],
)
def test_a_contact_whose_board_stopped_answering_is_lost_not_lifted(tmp_path, silence, kinds):
    scene = Path(write(tmp_path))
    text = (
        scene.read_text()
        .replace("duration_s = 1.0", "duration_s = 2.5")
        .replace("end_s = 0.7", "end_s = 1.1")
    )
    text = text.replace("[0.7, 35.0, 0.0]", "[1.1, 16.0, 0.0]")
    scene.write_text(f"{text}[effect.patch_silent]\nnodes = [1]\n{silence}\n")
    with skinbus.simulate(scene) as skin:
        events = [event for finder in [TouchEvents()] for cycle in skin for event in finder.step(cycle)]
    assert [kind for kind, _ in events if kind != "move"] == kinds
