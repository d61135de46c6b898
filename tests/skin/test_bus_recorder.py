"""Recordings are begun, marked and ended while something else goes on."""

import time

import pytest

from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.candump import CandumpReader
from skinbus.can.frame import Frame
from skinbus.errors import SkinbusError
from skinbus.skin.addresses import BusAddress
from skinbus.skin.bus_recorder import BusRecorder
from tests.cli.patience import PATIENCE_S


def test_frames_and_marks_are_in_the_recording_in_their_order(tmp_path):
    place = BusAddress("virtual", "test-bus-recorder", 1_000_000)
    recorder, sender = BusRecorder([place], tmp_path), PythonCanBus("virtual", place.channel)
    with pytest.raises(SkinbusError, match="nothing"):
        recorder.mark()
    path = recorder.start()
    with pytest.raises(SkinbusError, match="is being recorded"):
        recorder.start()
    for n in range(2):
        sender.send([Frame(0x181, bytes([n]), 0)])
        end = time.monotonic() + PATIENCE_S
        while recorder.n_frames < n + 1:
            assert time.monotonic() < end
            time.sleep(0.005)
        assert recorder.mark() == n + 1
    recorder.stop()
    recorder.stop()
    sender.close()
    assert not recorder.is_recording
    reader = CandumpReader(path)
    frames = [frame for frame, _ in reader]
    assert [frame.data[0] for frame in frames] == [0, 1]
    assert reader.n_strange == 0
    assert [number for number, _ in reader.marks] == [1, 2]
    assert frames[0].t_ns <= reader.marks[0][1] <= frames[1].t_ns <= reader.marks[1][1]


def test_file_that_cannot_be_made_is_reported(tmp_path):
    recorder = BusRecorder([BusAddress("virtual", "test-bus-recorder-2", 1_000_000)], tmp_path / "none")
    with pytest.raises(SkinbusError, match="none"):
        recorder.start()
    assert not recorder.is_recording
