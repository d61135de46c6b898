"""`skinbus monitor` says of each cycle what is in doubt: readings not proven fresh, tactels not plausible."""

import numpy as np

from skinbus.cli.commands.monitor import cycles
from skinbus.skin.listener import Listener
from tests.master.rig import Rig


def flags_of(rig, ms):
    """What a monitor on the bus says of each cycle of this time."""
    listener = Listener(127)
    _, _, frames = rig.run(ms)
    return [line["flags"] for line in cycles(listener, rig.wire.clock, frames, ())]


def test_cycles_without_doubt_have_no_flags():
    rig = Rig("pad")
    rig.run(1000)
    assert flags_of(rig, 200).count([]) > 10


def test_patch_without_fresh_readings_makes_cycles_incomplete():
    rig = Rig("pad")
    rig.run(1000)
    rig.patches.unplugged.add(1)
    assert ["incomplete"] in flags_of(rig, 100)


def test_tactels_at_a_rail_make_cycles_impaired():
    rig = Rig("pad")
    rig.run(1000)
    rig.patches.changes[1] = lambda tpdo, counts: np.full(4, -0x8000)
    assert "impaired" in flags_of(rig, 1500)[-1]
