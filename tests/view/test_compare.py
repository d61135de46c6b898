"""Contacts that two masters published, held against each other."""

import numpy as np

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm
from skinbus.objects.contacts import ContactState, pack_contacts
from skinbus.view.compare import Comparison

SUMMARY, CONTACT = 0x1FF, 0x681
MS = 1_000_000
CUT_SHORT = 8


def cycle(counter, *contacts, flags=0, slots=None):
    """The frames of a cycle; a contact is (id, link, state, s, a, force)."""
    frames = [Frame(SUMMARY, bytes([counter, len(contacts), 1, flags, 0, 0, 0, 0]), counter * 20 * MS)]
    for slot, contact in zip(slots or range(16), contacts, strict=False):
        names = ("id", "link", "state", "s", "a", "force")
        payload = pack_contacts(**{name: np.array([v]) for name, v in zip(names, contact, strict=True)})
        frames.append(Frame(CONTACT + slot, payload.tobytes()))
    return frames


def compare(recorded, made, **settings):
    """What is found between two lists of cycles."""
    comparison = Comparison(load_arm("forearm"), **settings)
    for frames in recorded:
        for frame in frames:
            comparison.take_recorded(frame)
    comparison.take_recorded(Frame(0x80, b"\x09"))
    for frames in made:
        comparison.take_made(frames[0].t_ns, frames)
    return comparison.end()


HELD = (3, 0, ContactState.HELD, 0.0778, 0.010, 8.0)
OTHER = (4, 0, ContactState.HELD, 0.020, -0.050, 2.0)
WRAP = load_arm("forearm").links[0].surface.period


def test_same_contacts_are_the_same_in_whatever_objects_and_with_whatever_ids():
    found = compare([cycle(1, HELD, OTHER)], [cycle(1, HELD, OTHER)])
    assert (found.n_same, found.n_renumbered, found.n_different) == (1, 0, 0)
    found = compare([cycle(1, HELD, OTHER)], [cycle(1, (9, *OTHER[1:]), (8, *HELD[1:]), slots=[3, 5])])
    assert (found.n_same, found.n_renumbered, found.n_different) == (1, 1, 0)


def test_differences_are_those_of_the_contacts_that_belong_together():
    moved = (3, 0, ContactState.HELD, 0.0788, 0.010, 8.5)
    found = compare([cycle(1, HELD), cycle(2, HELD, OTHER)], [cycle(1, HELD), cycle(2, OTHER, moved)])
    assert (found.n_same, found.n_different, found.n_missing, found.n_new) == (1, 1, 0, 0)
    assert abs(found.largest_m - 1e-3) < 1e-9
    assert abs(found.largest_n - 0.5) < 1e-9
    assert found.first_ns == 40 * MS


def test_another_state_is_a_difference():
    coasting = (3, 0, ContactState.COAST, *HELD[3:])
    found = compare([cycle(1, HELD, OTHER)], [cycle(1, coasting, OTHER)])
    assert (found.n_different, found.n_states, found.largest_m, found.n_new) == (1, 1, 0.0, 0)


def test_distance_goes_the_short_way_round_a_link():
    left = (1, 0, ContactState.HELD, 0.05, WRAP / 2 - 1e-3, 1.0)
    right = (1, 0, ContactState.HELD, 0.05, -WRAP / 2 + 1e-3, 1.0)
    found = compare([cycle(1, left)], [cycle(1, right)])
    assert abs(found.largest_m - 2e-3) < 2e-4
    assert found.n_missing == 0


def test_contacts_that_only_one_has_are_counted():
    far = (3, 0, ContactState.HELD, 0.1, 0.1, 8.0)
    found = compare([cycle(1, HELD), cycle(2)], [cycle(1, far, OTHER), cycle(2, OTHER)])
    assert (found.n_missing, found.n_new, found.largest_m) == (1, 3, 0.0)


def test_cycles_that_only_one_has_are_counted_and_the_counter_may_go_round():
    counters = [*range(1, 241), *range(1, 241)]
    recorded = [cycle(counter, HELD) for counter in counters[5:]]
    comparison = Comparison(load_arm("forearm"))
    for n, counter in enumerate(counters):
        comparison.take_made(n * 20 * MS, cycle(counter, HELD))
        if n >= 5:
            for frame in recorded[n - 5]:
                comparison.take_recorded(frame)
    found = comparison.end()
    assert (found.n_same, found.n_different) == (474, 0)  # the last may have been cut short
    assert (found.n_recorded_only, found.n_made_only) == (0, 6)


def test_a_cycle_in_which_the_recording_ends_is_not_compared():
    comparison = Comparison(load_arm("forearm"))
    for n in (1, 2):
        comparison.take_made(n * 20 * MS, cycle(n, HELD, OTHER))
    for frame in [*cycle(1, HELD, OTHER), *cycle(2, HELD)]:
        comparison.take_recorded(frame)
    found = comparison.end()
    assert (found.n_same, found.n_different, found.n_made_only) == (1, 0, 1)


def test_contacts_taken_back_and_strange_frames_are_no_contacts():
    end = [
        Frame(CONTACT, bytes(8)),
        Frame(CONTACT, bytes(3)),
        Frame(SUMMARY, bytes(3)),
        Frame(CONTACT, b"\xff" * CLASSIC_BYTES, flags=2),
    ]
    found = compare([cycle(1, HELD) + end], [cycle(1, HELD)])
    assert (found.n_same, found.n_different) == (1, 0)


def test_only_the_cycles_of_a_time_count():
    cycles = [cycle(n, HELD) for n in range(1, 11)]
    found = compare(cycles, cycles, counts=lambda t_ns: 100 * MS <= t_ns <= 160 * MS)
    assert found.n_same == 4


def test_cycles_that_the_master_says_it_hurried_are_reported():
    found = compare(
        [cycle(1, HELD, flags=CUT_SHORT), cycle(2, HELD)], [cycle(1), cycle(2)], reasons=CUT_SHORT
    )
    assert (found.n_different, found.n_flagged) == (2, 1)
