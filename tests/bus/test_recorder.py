"""A recorder on its buses: all that comes, in order, also when a bus goes away in the middle."""

import io

import pytest

from skinbus.bus.recorder import Recorder
from skinbus.can.candump import CandumpReader, CandumpWriter
from skinbus.can.frame import ERROR, EXTENDED, FD, RTR, Frame
from tests.bus.loop_rig import MS, run


@pytest.mark.parametrize("outage", [None, (7 * MS, 50 * MS)])
def test_every_kind_of_frame_is_recorded_before_and_after_an_outage(outage):
    kinds = [(0x80, 0), (0x181, 0), (0x12345, EXTENDED), (0x701, RTR), (0x20, ERROR), (0x185, FD)]
    arrivals = [
        Frame(can_id, b"\x01", (k + after) * MS, flags)
        for after in (0, 900)
        for k, (can_id, flags) in enumerate(kinds)
    ]
    file = io.StringIO()
    run(Recorder(CandumpWriter(file), 1), until_ns=2000 * MS, arrivals=arrivals, outage=outage)
    file.seek(0)
    assert [frame._replace(data=b"\x01") for frame, _ in CandumpReader(file)] == arrivals
