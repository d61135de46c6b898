"""What a client on the bus may do to the master: nothing that stops the cycle or leaves an old contact."""

import pytest

from skinbus.can.frame import Frame
from skinbus.objects import cia
from skinbus.objects.contacts import ContactState
from tests.files import put
from tests.master.rig import Rig
from tests.master.sdo_reads import MASTER, write

FIRST_CONTACT = 0x681
SCENE = """
[scene]
title = "one touch that ends"
arm = "pad"
duration_s = 100.0
[[touch]]
link = "plate"
s_mm = 25.0
a_mm = 0.0
force_n = 6.0
start_s = 0.3
end_s = 1.5
"""


@pytest.fixture
def bench(tmp_path):
    bench = Rig(put(tmp_path, "scene.toml", SCENE), level="kmeans")
    bench.run(600)
    return bench


def last_contact(frames):
    """Force (0.01 N) and state of the newest TPDO of the first contact."""
    data = [frame.data for frame in frames if frame.can_id == FIRST_CONTACT][-1]
    return int.from_bytes(data[6:8], "little"), data[1] >> 4


def test_what_the_cycle_lives_by_is_the_arm_files(bench):
    for index, value in (
        (cia.SYNC_COB_ID, 0x80),
        (cia.SYNC_PERIOD, 0),
        (cia.SYNC_PERIOD, 1),
        (cia.NMT_STARTUP, 0),
        (cia.BOOT_TIME, 1),
    ):
        answer = write(bench.master.device, index, 0, value.to_bytes(4, "little"))
        assert answer.abort == cia.AbortCode.LOCAL_CONTROL, hex(index)
    cycles, _, _ = bench.run(1000)
    assert len(cycles) == pytest.approx(1e9 / bench.master.period_ns, abs=1)


def test_no_pdo_of_the_master_gets_an_identifier_of_a_patch(bench):
    def move(value):
        value |= cia.COB_ID_NO_RTR
        return write(bench.master.device, cia.TPDO_COMMUNICATION + 1, 1, value.to_bytes(4, "little")).abort

    assert move(cia.COB_ID_INVALID | bench.master.device.get(cia.TPDO_COMMUNICATION + 1, 1)) is None
    for cob_id in (0x181, 0x481, 0x81, 0x581, 0x701):
        assert move(cob_id) == cia.AbortCode.VALUE_INVALID, hex(cob_id)
    assert move(0x4A1) is None


@pytest.mark.slow
@pytest.mark.parametrize("command", [cia.NmtCommand.RESET_NODE, cia.NmtCommand.RESET_COMMUNICATION])
@pytest.mark.parametrize("while_touched", [True, False])
def test_reset_of_the_master_takes_its_contacts_back(bench, command, while_touched):
    """What was touched before the reset is gone, or seen anew; it is never held by nobody."""
    if not while_touched:
        bench.run(860)  # the touch ends before the patches are up again
    frames = bench.run(20)[2]
    assert last_contact(frames)[1] == ContactState.HELD
    bench.say(Frame(cia.NMT_COMMAND_ID, bytes([command, MASTER])))
    _, _, frames = bench.run(10)
    force, state = last_contact(frames)
    assert (force, state) == (0, 0)
    _, _, frames = bench.run(400)
    if while_touched:
        assert last_contact(frames)[1] == ContactState.HELD
    bench.run(2500)
    record = bench.master.device
    assert (record.get(0x3001, 2) >> 4, record.get(0x3001, 5)) in {(0, 0), (ContactState.LIFT, 0)}
