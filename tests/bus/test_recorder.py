"""A recorder on its buses: all that comes, in order, also when a bus goes away in the middle."""

import io

from skinbus.bus.recorder import Recorder
from skinbus.can.candump import CandumpReader, CandumpWriter
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import ERROR, EXTENDED, FD, RTR, Frame
from tests.bus.loop_rig import MS, run


def recording(file):
    """The frames of what was written, with the names of their buses."""
    file.seek(0)
    return list(CandumpReader(file))


def test_every_kind_of_frame_is_recorded():
    kinds = [(0x80, 0), (0x181, 0), (0x12345, EXTENDED), (0x701, RTR), (0x20, ERROR), (0x185, FD)]
    arrivals = [Frame(can_id, b"\x01", k * MS, flags) for k, (can_id, flags) in enumerate(kinds)]
    file = io.StringIO()
    run(Recorder(CandumpWriter(file)), until_ns=100 * MS, arrivals=arrivals)
    written = [frame._replace(data=b"\x01") for frame, _ in recording(file)]
    assert written == arrivals


def test_a_bus_that_goes_down_is_recorded_again_when_it_is_back():
    arrivals = [Frame(1, b"", 10 * MS), Frame(2, b"", 900 * MS), Frame(3, b"", 1000 * MS)]
    events = []
    file = io.StringIO()
    bus, report = run(
        Recorder(CandumpWriter(file)),
        until_ns=2000 * MS,
        arrivals=arrivals,
        outage=(20 * MS, 600 * MS),
        on_event=events.append,
    )
    assert [frame.can_id for frame, _ in recording(file)] == [1, 2, 3]
    assert [event.kind for event in events] == [EventKind.BUS_LOST, EventKind.BUS_BACK]
    assert report.n_outages == 1
    assert bus.sent == []


def test_frames_that_found_no_room_are_counted_where_they_are_missing():
    file = io.StringIO()
    recorder = Recorder(CandumpWriter(file, channels=["can0", "can1"]), 2)
    recorder.step(0, [Frame(1)])
    recorder.bus_news(0, Event(t_ns=0, kind=EventKind.FRAMES_DROPPED, count=7, bus=1))
    recorder.bus_news(0, Event(t_ns=0, kind=EventKind.ERROR_PASSIVE))
    recorder.step(0, [Frame(2)])
    assert recorder.n_dropped == 7
    assert file.getvalue().splitlines()[1].startswith("DROPCOUNT: dropped 7 CAN frames on 'can1'")
    file.seek(0)
    reader = CandumpReader(file)
    assert len(list(reader)) == 2
    assert reader.n_dropped == 7
