"""Recordings that tests of commands read, and change."""

from contextlib import closing

from skinbus.can.candump import CandumpReader, CandumpWriter
from skinbus.can.clock import VirtualClock
from tests.files import put
from tests.master.rig import Rig

EPOCH_NS = 1_795_263_452_171_891_000
SECONDS = 3.0
"""Two touches: one ends, the other begins with the end."""


class WallClock(VirtualClock):
    """The clock of a recording: it begins at a time of day."""

    def wall_ns(self, t_ns):
        return EPOCH_NS + t_ns


def record_pad(path):
    """Record the scene pad, from the boot of its patches on."""
    rig = Rig("pad", level="fit")
    with closing(CandumpWriter(path, clock=WallClock())) as writer:
        rig.wire.tap(lambda frame: writer.write([frame]))
        rig.run(SECONDS * 1e3)
        now_ns = rig.wire.now_ns
        writer.write([frame._replace(t_ns=now_ns) for frame in rig.master.last_frames(now_ns)])


def frames_in(path, channel="can0"):
    return [frame for frame, name in CandumpReader(path) if name == channel]


def changed(folder, lines):
    """A file of these lines."""
    return put(folder, "changed.log", "".join(f"{line}\n" for line in lines))
