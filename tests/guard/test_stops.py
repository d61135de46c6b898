"""Stops: as the command line names them, and how a node is told until it has understood."""

import pytest

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.errors import AddressError
from skinbus.guard.stops import REPEAT_NS, RESEND_NS, OutsideStop, parse_stop
from tests.guard.rig import ARMS, GFC, QUICK_STOP, Rig

TOLD = {
    "cia402:100": "2b406000 0200 0000",
    "output:100:6200:1:00": "2f006201 00 000000",
    "output:100:0x6200:0A:0x1F": "2f00620a 1f 000000",
    "output:100:6300:1:12fe": "2b006301 fe12 0000",
    "output:100:2345:0:01020304": "23452300 04030201",
}


@pytest.mark.parametrize("name", [*ARMS])
def test_all_nodes_are_told_in_the_step_of_the_stop_by_expedited_downloads(name):
    rig = Rig(name, stops=TOLD)
    *others, last = [rig.answer(f"60{bytes.fromhex(data)[1:4].hex()}00000000") for data in TOLD.values()]
    # answers to somebody else, who asked before, confirm nothing
    assert rig.step(Frame(GFC), *others, last) == [(0x664, bytes.fromhex(data)) for data in TOLD.values()]
    assert {frame.bus for frame in rig.sent} == {rig.last_bus}
    rig.step(*others)
    assert not rig.guard.is_settled
    rig.step(last)
    assert rig.guard.is_settled


@pytest.mark.parametrize("text", ["command:/usr/bin/stop --now robot:1", "python:my_robot:stop"])
def test_what_the_process_does_itself_is_taken_as_it_is_written(text):
    kind, _, what = text.partition(":")
    assert parse_stop(text, ARMS["pad"]) == OutsideStop(kind, what)


WRONG = """
cia402 cia402: cia402:0 cia402:128 cia402:127 cia402:1 cia402:x cia402:-5 cia402:5:6 cia402:lower/100
command: python: quick:5 output:100 output:100:6200:1 output:100:6200:1:0 output:100:6200:1:
output:100:6200:1:0102030405 output:100:66200:1:00 output:100:6200:100:00 output:100:6200:1:gg
"""


@pytest.mark.parametrize("text", ["", "command: ", *WRONG.split()])
def test_anything_else_is_refused(text):
    with pytest.raises(AddressError, match="wanted"):
        parse_stop(text, ARMS["pad"])


@pytest.mark.parametrize("text", ["cia402:100", "cia402:elbow/100"])
def test_a_bus_that_is_not_there_is_refused_with_those_that_are(text):
    with pytest.raises(AddressError, match="the buses are upper, lower"):
        parse_stop(text, ARMS["arm-two-buses"])


@pytest.fixture
def rig():
    """A guard that has just stopped."""
    rig = Rig()
    rig.step(Frame(GFC))
    return rig


def test_a_node_is_told_again_until_it_answers_and_its_silence_is_said(rig):
    for _ in range(44):
        assert rig.step(after=RESEND_NS - 1) == []
        assert rig.step(after=1) == [QUICK_STOP]
    assert rig.count(EventKind.NOT_CONFIRMED) == 44
    assert not rig.guard.is_settled
    rig.step(rig.answer())
    assert rig.guard.is_settled
    assert rig.count(EventKind.CONFIRMED) == 1


def test_a_node_that_refuses_is_told_again_and_why_is_said(rig):
    rig.step(rig.answer("8040600022000008"))
    assert rig.events[-1].kind is EventKind.NOT_CONFIRMED
    assert "0x08000022" in rig.events[-1].detail
    assert rig.step(after=RESEND_NS) == [QUICK_STOP]
    assert not rig.guard.is_settled


def test_a_node_that_has_confirmed_is_told_again_for_ever(rig):
    for _ in range(20):
        rig.step(rig.answer())
        assert rig.step(rig.answer(), after=REPEAT_NS - 1) == []  # that was to somebody else
        assert rig.step(after=1) == [QUICK_STOP]
    assert rig.count(EventKind.CONFIRMED) == 1
    rig.step(after=RESEND_NS)
    assert not rig.guard.is_settled
