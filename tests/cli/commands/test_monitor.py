"""`skinbus monitor` says of each cycle what is in doubt: readings not proven fresh, tactels not plausible."""

import numpy as np
import pytest

from skinbus.cli.commands.monitor import cycles
from skinbus.config.system import load_arm
from skinbus.master.level_control import CycleFlags
from skinbus.objects.contacts import ContactState
from skinbus.skin.listener import ContactRow, Listener, Summary, why_not_of
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


@pytest.mark.parametrize(
    ("alive", "link", "s", "a", "why"),
    [
        (1, 0, 0.055, 0.02, None),  # at the rim of the plate of 50 mm
        (2, 0, 0.02, 0.0, "2 patches are at work, pad has 1"),
        (1, 2, 0.02, 0.0, "a contact is on link 2, pad has 1"),
    ],
)
def test_what_another_arm_has_published_is_not_shown_as_that_of_the_arm_file(alive, link, s, a, why):
    summary = Summary(1, 1, alive, CycleFlags(0), "fit", 100, 1000, 0)
    row = ContactRow(slot=0, id=1, link=link, state=ContactState.HELD, s=s, a=a, force=3.0, t_ns=0)
    assert why_not_of(load_arm("pad"), summary, [row]) == why
