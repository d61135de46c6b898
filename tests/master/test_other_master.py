"""Another master on the bus: told when it comes, told when it is gone, and no end of the cycles."""

import pytest

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm
from skinbus.master import Master
from skinbus.master.commissioning.sessions import GONE_NS
from skinbus.objects.cia import EmcyCode
from tests.master.commission import Bench, patch
from tests.master.rig import MS, Rig

SYNC = 0x080


class Stranger(Core):
    """Sends SYNC every so often, for some time."""

    cob_ids = frozenset()

    def __init__(self, begin_ns, end_ns, period_ns):
        self.next_ns, self.end_ns, self.period_ns = begin_ns, end_ns, period_ns

    def step(self, now_ns, frames):
        if now_ns < self.next_ns:
            return Step((), (), self.next_ns)
        self.next_ns += self.period_ns
        return Step([Frame(SYNC)], (), self.next_ns if self.next_ns < self.end_ns else NEVER)


def emcy(frames):
    return [(int.from_bytes(f.data[:2], "little"), f.data[3:7]) for f in frames if f.can_id == 0x0FF]


def test_another_master_is_reported_once_when_it_comes_and_once_when_it_is_gone():
    rig = Rig("pad")
    rig.run(1000)
    assert not [event for event in rig.events if event.kind.startswith("other-master")]
    begin_ns = rig.wire.now_ns + 3 * MS
    rig.wire.attach(Stranger(begin_ns, begin_ns + 500 * MS, 17 * MS))
    reports, events, frames = rig.run(500)
    assert [event.kind for event in events if event.kind.startswith("other-master")] == [
        EventKind.OTHER_MASTER
    ]
    assert (EmcyCode.COMMUNICATION, SYNC.to_bytes(4, "little")) in emcy(frames)
    assert len(reports) >= 45
    reports, events, frames = rig.run(100 + GONE_NS / MS)
    assert [event.kind for event in events if event.kind.startswith("other-master")] == [
        EventKind.OTHER_MASTER_END
    ]
    assert rig.master.device.get(0x1001, 0) == 0
    assert reports[-1].n_fresh == 1


@pytest.mark.parametrize("later_ms", [0, 1, 30, 700])
def test_two_masters_do_not_reset_each_other_for_ever(later_ms):
    bench, reports = Bench(patch(1)), []
    bench.wire.attach(Master(load_arm("pad"), on_cycle=reports.append))
    bench.pass_ms(later_ms)
    bench.wire.attach(Master(load_arm("pad"), on_cycle=reports.append))
    bench.pass_ms(2000)
    resets = [f for f in bench.frames if (f.can_id, f.data) == (0x000, b"\x82\x00")]
    assert len(resets) <= 2
    assert len(reports) > 50
