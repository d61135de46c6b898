"""Slots: who is shown where, and for how long."""

from types import SimpleNamespace

import numpy as np
import pytest

from skinbus.master.slots import Slots
from skinbus.model import Link, Surface

LINKS = [Link("a", Surface.cylinder(0.2, 0.05)), Link("b", Surface.plane(0.2, 0.2))]


class Columns(SimpleNamespace):
    """The columns of Contacts that slots look at."""

    def __len__(self):
        return len(self.s)


def contacts(*rows):
    """Rows of (link, s, a)."""
    table = np.array(rows, float).reshape(-1, 3)
    return Columns(link=table[:, 0].astype(int), s=table[:, 1], a=table[:, 2])


@pytest.fixture
def slots():
    return Slots(LINKS, 4)


def test_contact_keeps_its_slot_and_identity_while_it_moves_through_the_wrap(slots):
    half = 0.5 * LINKS[0].surface.period
    ids = set()
    for a in np.linspace(half - 0.05, half + 0.05, 20):
        slots.assign(contacts((0, 0.1, LINKS[0].surface.wrap(a))))
        ids.add(int(slots.id[0]))
    assert ids == {1}


def test_order_of_the_contacts_does_not_matter(slots):
    slots.assign(contacts((0, 0.05, 0.0), (0, 0.15, 0.0)))
    row, gone = slots.assign(contacts((0, 0.151, 0.0), (0, 0.051, 0.0)))
    assert row[:2].tolist() == [1, 0]
    assert not len(gone)


def test_same_place_on_another_link_is_another_contact(slots):
    slots.assign(contacts((0, 0.1, 0.0)))
    _, gone = slots.assign(contacts((1, 0.1, 0.0)))
    assert gone.tolist() == [0]
    assert slots.id.tolist() == [0, 2, 0, 0]


def test_freed_slot_rests_for_one_cycle(slots):
    slots.assign(contacts((0, 0.1, 0.0)))
    row, gone = slots.assign(contacts((1, 0.0, 0.0)))
    assert (gone.tolist(), row.tolist()) == ([0], [-1, 0, -1, -1])


def test_more_contacts_than_slots_leave_the_rest_out(slots):
    row, _ = slots.assign(contacts(*((1, 0.02 * n, 0.0) for n in range(6))))
    assert sorted(row.tolist()) == [0, 1, 2, 3]


def test_identities_in_sight_are_not_given_again(slots):
    slots.assign(contacts((0, 0.1, 0.0)))
    for n in range(600):
        slots.assign(contacts((0, 0.1, 0.0), (1, 0.1 * (n % 2), 0.0)))
        ids = slots.id[slots.id > 0]
        assert len(set(ids.tolist())) == len(ids)
        assert ids[0] == 1
