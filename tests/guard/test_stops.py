"""Stops: as the command line names them, and how a node is told until it has understood."""

import pytest

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.errors import AddressError
from skinbus.guard.stops import REPEAT_NS, RESEND_NS, NodeStop, OutsideStop, parse_stop
from tests.guard.rig import ARMS, DRIVE, GFC, Rig, quick_stop

ROWS = {
    "cia402:100": "2b406000 0200 0000",
    "output:100:6200:1:00": "2f006201 00 000000",
    "output:100:0x6200:0A:0x1F": "2f00620a 1f 000000",
    "output:100:6300:1:12fe": "2b006301 fe12 0000",
    "output:100:2345:0:01020304": "23452300 04030201",
}


@pytest.mark.parametrize("text", ROWS)
def test_a_node_is_told_by_an_expedited_download(text):
    rig = Rig(stop=text.replace("100", "{}"))
    rig.step(Frame(GFC))
    assert [frame[:2] for frame in rig.sent] == [(0x600 + DRIVE, bytes.fromhex(ROWS[text]))]


def test_on_an_arm_of_several_buses_a_stop_names_its_bus():
    arm = ARMS["arm-two-buses"]
    for bus, settings in enumerate(arm.buses):
        stop = parse_stop(f"cia402:{settings.name}/100", arm)
        assert isinstance(stop, NodeStop)
        assert (stop.bus, stop.node_id) == (bus, 100)


@pytest.mark.parametrize("text", ["command:/usr/bin/stop --now robot:1", "python:my_robot:stop"])
def test_what_the_process_does_itself_is_taken_as_it_is_written(text):
    kind, _, what = text.partition(":")
    assert parse_stop(text, ARMS["pad"]) == OutsideStop(kind, what)


@pytest.mark.parametrize(
    "text",
    [
        "", "cia402", "cia402:", "cia402:0", "cia402:128", "cia402:1", "cia402:x", "cia402:-5", "cia402:5:6",
        "cia402:lower/100", "command:", "command: ", "python:", "quick:5", "output:100", "output:100:6200:1",
        "output:100:6200:1:0", "output:100:6200:1:", "output:100:6200:1:0102030405", "output:100:66200:1:00",
        "output:100:6200:100:00", "output:100:6200:1:gg",
    ],
)  # fmt: skip
def test_anything_else_is_refused(text):
    with pytest.raises(AddressError, match="wanted"):
        parse_stop(text, ARMS["pad"])


@pytest.mark.parametrize("name", ["cia402:100", "cia402:elbow/100"])
def test_a_bus_that_is_not_there_is_refused_with_those_that_are(name):
    with pytest.raises(AddressError, match="the buses are upper, lower"):
        parse_stop(name, ARMS["arm-two-buses"])


def requests(rig):
    """How often the drive was told, which is all that it is told."""
    told = [frame[:2] for frame in rig.sent if frame.data[0] != 0x80]  # an abort of a silent transfer
    assert set(told) <= {quick_stop()[:2]}
    return len(told)


def test_it_is_told_again_until_it_answers_and_its_silence_is_said():
    rig = Rig()
    rig.step(Frame(GFC))
    for k in range(1, 45):
        assert requests(rig) == k
        rig.step(after=RESEND_NS)
    said = rig.kinds().count(EventKind.STOP_FAILED)
    assert 2 <= said <= 3  # once a second
    assert not rig.guard.is_confirmed
    rig.step(rig.answer())
    assert rig.guard.is_confirmed
    assert rig.kinds()[-1] is EventKind.STOP_CONFIRMED


def test_a_node_that_refuses_is_told_again_and_that_is_said():
    rig = Rig()
    rig.step(Frame(GFC))
    rig.step(rig.answer()._replace(data=bytes.fromhex("8040600022000008")))
    assert "0x08000022" in rig.events[-1].detail
    assert rig.events[-1].kind is EventKind.STOP_FAILED
    assert requests(rig) == 1
    rig.step(after=RESEND_NS)
    assert requests(rig) == 2


def test_one_that_has_answered_is_told_again_for_ever():
    rig = Rig()
    rig.step(Frame(GFC))
    for k in range(1, 20):
        assert requests(rig) == k
        rig.step(rig.answer())
        rig.step(after=REPEAT_NS - 1)
        assert requests(rig) == k
        rig.step(after=1)
    assert rig.kinds().count(EventKind.STOP_CONFIRMED) == 1


def test_a_frame_that_did_not_go_out_is_sent_again():
    rig = Rig()
    rig.guard.not_sent(rig.now_ns, rig.step(Frame(GFC)))
    rig.step(after=RESEND_NS)
    assert requests(rig) == 2


def test_several_nodes_are_told_in_one_step():
    rig = Rig()
    stops = [parse_stop(text, rig.arm) for text in ("cia402:100", "output:100:6200:1:00", "cia402:101")]
    rig = Rig(more=stops)
    assert [frame[:2] for frame in rig.step(Frame(GFC))] == [
        (0x664, bytes.fromhex("2b40600002000000")),
        (0x664, bytes.fromhex("2f00620100000000")),
        (0x665, bytes.fromhex("2b40600002000000")),
    ]
    rig.step(Frame(0x5E4, bytes.fromhex("6000620100000000")), Frame(0x5E5, bytes.fromhex("6040600000000000")))
    assert not rig.guard.is_confirmed
    rig.step(rig.answer())
    assert rig.guard.is_confirmed
