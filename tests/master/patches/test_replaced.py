"""Boards that were replaced or doubled."""

import pytest

from skinbus.can.event import EventKind
from skinbus.master.health import Health
from tests.master.commission import Bench, patch
from tests.master.misbehaving import Late

pytestmark = pytest.mark.slow


def test_a_board_that_was_replaced_is_named_in_event_and_health_and_has_a_zero_of_its_own():
    bench = Bench(patch(1, serial=11))
    master = bench.start(level="kmeans", on_cycle=lambda report: health.observe(report))
    health = Health(master.cycle)
    bench.pass_ms(3000)
    health.records["samples"] = 7
    bench.wire.detach(bench.ports[0])
    board = patch(1, serial=12)
    for tactel in range(1, 17):
        board.set(0x6401, tactel, 110)  # its zero is 0.8 kPa
    bench.wire.attach(board)
    bench.pass_ms(3000)
    assert max(master.cycle.pressures) < 200.0
    (event,) = [event for event in bench.events if event.kind == EventKind.PATCH_REPLACED]
    assert event.detail == "serial number 12 in place of 11"
    (own,) = health.as_tables(health.snapshot())["health"].values()
    assert set(own["serial"]) == {12}
    assert max(own["samples"]) < 7


def test_two_boards_with_one_node_id_are_asked_more_and_more_rarely():
    bench = Bench(patch(1, serial=11), Late(patch(1, serial=12)))
    bench.start(level="kmeans")
    bench.pass_ms(20_000)
    boots = [f for f in bench.frames if f.can_id == 0x601 and f.data[1:4] == bytes([0x00, 0x10, 0])]
    assert 4 <= len(boots) <= 7  # at 0, 1, 2, 4, 8 and 16 s
