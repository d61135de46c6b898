"""The node that is made faulty, what the master sends of it, and what a healthy arm looks like."""

from skinbus.master.patches.table import PatchState
from skinbus.objects import cia
from skinbus.objects.cia import EmcyCode

MASTER_EMCY_ID = cia.EMCY_BASE + 127


NODE = 5


STATES = PatchState


def emcy(frames):
    """Codes and node-IDs of the master's EMCY, in order."""
    return [
        (EmcyCode(int.from_bytes(f.data[:2], "little")), f.data[3])
        for f in frames
        if f.can_id == MASTER_EMCY_ID
    ]


def last(rig):
    return rig.reports[-1]


def wake(rig):
    """Let the device send at once what it has been asked to by hand."""
    rig.world.hosts[0].wake(rig.scene.arm.patch_at(NODE), rig.wire.now_ns + 1)
    rig.wire.wake(rig.wire.ports[0])


def assert_all_well(rig, n_patches=2):
    """Everybody is operational and fresh, and no error is left."""
    assert last(rig).n_fresh == n_patches
    assert rig.state(NODE) == STATES.OPERATIONAL
    assert rig.master.device.get(cia.ERROR_REGISTER, 0) == 0
