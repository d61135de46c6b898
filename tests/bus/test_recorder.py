"""A recorder on its buses: all that comes, in order, also when a bus goes away in the middle."""

import io

from skinbus.bus.recorder import Recorder
from skinbus.can.candump import CandumpReader, CandumpWriter
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
