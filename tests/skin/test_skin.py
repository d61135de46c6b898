"""One interface: cycles in order and counted where they are lost, errors raised, handlers called once."""

import asyncio
import logging

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.errors import ArgumentError, BusError, LocalProtocolError
from skinbus.skin.cycle import SkinLayout, no_cycle
from skinbus.skin.feed import KEPT, Feed
from skinbus.skin.skin import Skin
from tests.cli.patience import PATIENCE_S
from tests.skin.scripted import LAYOUT, scripted


@pytest.fixture
def feed():
    return Feed(LAYOUT, "a test")


def push(feed, *numbers, contacts=()):
    for number in numbers:
        feed.push(scripted(number, *contacts))


def test_before_the_first_cycle_there_is_nothing_and_its_age_is_infinite(feed):
    with Skin(feed) as skin:
        cycle = skin.latest()
        assert (cycle.number, cycle.contacts, cycle.age_s) == (0, (), float("inf"))
        assert not cycle.readings.valid.any()
        assert [patch.state.name for patch in skin.patches] == ["ABSENT"]
        assert skin.patches[0].age_s == float("inf")


def test_every_cycle_comes_once_in_order_and_the_end_ends_the_iteration(feed):
    push(feed, *range(1, 6))
    feed.end()
    with Skin(feed) as skin:
        assert next(skin).number == 1
        assert [cycle.number for cycle in skin] == [2, 3, 4, 5]
        assert skin.n_lost == 0


def test_what_a_slow_consumer_loses_is_counted_and_logged(feed, caplog):
    push(feed, *range(1, KEPT + 8))
    feed.end()
    with Skin(feed) as skin, caplog.at_level(logging.WARNING, "skinbus"):
        assert [cycle.number for cycle in skin] == list(range(8, KEPT + 8))
        assert skin.n_lost == 7
    assert "7 cycles lost" in caplog.text


def test_latest_is_the_newest_and_takes_nothing_from_the_iteration(feed):
    push(feed, 1, 2, 3)
    with Skin(feed) as skin:
        assert skin.latest().number == 3
        assert next(skin).number == 1


def test_async_iteration_gives_the_same_and_a_cancelled_task_loses_nothing(feed):
    async def take():
        skin = Skin(feed)
        waiting = asyncio.ensure_future(anext(skin))
        await asyncio.sleep(0)
        waiting.cancel()
        push(feed, 1, 2, 3)
        feed.end()
        numbers = [cycle.number async for cycle in skin]
        skin.close()
        return numbers

    assert asyncio.run(take()) == [1, 2, 3]


def test_what_ends_the_source_is_raised_after_the_cycles_before_it(feed):
    push(feed, 1)
    feed.end(BusError("gone"))
    skin = Skin(feed)
    assert next(skin).number == 1
    with pytest.raises(BusError, match="gone"):
        next(skin)
    with pytest.raises(BusError, match="gone"):
        skin.latest()


def test_handlers_are_called_once_for_each_event_by_who_takes_the_cycles(feed):
    said = []
    with Skin(feed) as skin:
        for kind in ("touch", "lift"):
            skin.on(kind, lambda contact, kind=kind: said.append((kind, contact.id)))
        push(feed, 1, 2, 3, contacts=[(9, "HELD")])
        assert next(skin).number == 1
        assert skin.latest().number == 3
        push(feed, 4)
        skin.wait(0.01)
    assert said == [("touch", 9), ("lift", 9)]


def test_what_a_handler_raises_is_raised_where_the_skin_is_used(feed):
    def fail(contact):
        raise ZeroDivisionError

    with Skin(feed) as skin:
        skin.on("touch", fail)
        push(feed, 1, contacts=[(9, "HELD")])
        with pytest.raises(ZeroDivisionError):
            skin.wait(PATIENCE_S)


def test_an_unknown_event_is_refused(feed):
    with Skin(feed) as skin, pytest.raises(ValueError, match="touch, move, lift"):
        skin.on("press", print)


def test_leaving_the_block_closes_the_source_also_on_an_exception():
    class Closed(Feed):
        n = 0

        def close(self):
            self.n += 1

    feed = Closed(LAYOUT, "a test")
    with pytest.raises(KeyboardInterrupt), Skin(feed):
        raise KeyboardInterrupt
    assert feed.n == 1
    skin = Skin(feed)
    skin.close()
    skin.close()
    assert feed.n == 2


def test_readings_of_a_patch_are_had_by_node_id_and_bus():
    layout = SkinLayout.of(
        load_arm("arm-two-buses")
    )  # 27 and 21 boards of 16 tactels, node-IDs from 1 on both
    cycle = no_cycle(layout)
    cycle.readings.pressures[:] = np.arange(layout.n_tactels) // 16
    with Skin(Feed(layout, "a test")) as skin:
        assert (skin.patch_at(3, "upper"), skin.patch_at(3, "lower"), skin.patch_at(27)) == (2, 29, 26)
        for patch in skin.patches:
            of_one = cycle.readings_of(patch.node_id, patch.bus)
            assert of_one.pressures.tolist() == [skin.patch_at(patch.node_id, patch.bus)] * 16
            assert len(of_one.valid) == len(of_one.faults) == 16
    with pytest.raises(ArgumentError, match="several patches have node-ID 3: it is on buses upper, lower"):
        cycle.readings_of(3)
    with pytest.raises(ArgumentError, match="no patch has node-ID 27 on bus 'lower': it is on buses upper"):
        cycle.readings_of(27, "lower")


@pytest.mark.parametrize("patch", [1, -1, "grip", 0.5])
def test_a_zero_of_a_patch_that_there_is_not_is_refused(feed, patch):
    with Skin(feed) as skin, pytest.raises(ArgumentError, match=r"wanted an index in patches, 0\.\.0"):
        skin.zero(patch)


def test_a_source_that_cannot_zero_says_so(feed):
    with Skin(feed) as skin, pytest.raises(LocalProtocolError):
        skin.zero()
