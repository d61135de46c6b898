"""The master on the in-process wire: cycles, contacts on the bus, and patches that come and go."""

import numpy as np
import pytest

from skinbus.objects.contacts import LENGTH_STEP, PAYLOAD, ContactState
from tests.master.buses_rig import CONTACT_IDS
from tests.master.rig import Rig

pytestmark = pytest.mark.slow


@pytest.fixture
def forearm():
    rig = Rig("forearm")
    rig.run(1500)
    return rig


def test_contact_of_a_touch_is_on_the_bus_as_its_tpdo_and_record_say(forearm):
    cycles, _, frames = forearm.run(200)
    payload = next(f.data for f in reversed(frames) if f.can_id == CONTACT_IDS[0])
    c = np.frombuffer(payload, PAYLOAD)[0]
    truth = forearm.scene.touches_at(1.6)
    assert c["link_state"] == ContactState.HELD << 4
    assert abs(c["s"] * LENGTH_STEP - truth.s[0]) < 2e-3
    assert abs(c["a"] * LENGTH_STEP - truth.a[0]) < 2e-3
    get = forearm.master.device.get
    assert bytes(get(0x3001, sub) & 0xFF for sub in (1, 2)) == payload[:2]
    assert get(0x3001, 25) == np.float32(cycles[-1].contacts.s[0])
    x, y, z, nx, ny, nz = (get(0x3001, sub) for sub in range(12, 18))
    radius = forearm.scene.arm.links[0].surface.radius
    assert np.hypot(y, z) == np.float32(radius) or abs(np.hypot(y, z) - radius) < 1e-6
    assert abs(nx) < 1e-6
    assert np.allclose([ny * radius, nz * radius], [y, z], atol=1e-6)
    assert abs(x - get(0x3001, 25)) < 1e-6


def test_contact_of_an_unplugged_patch_coasts_says_so_and_is_the_same_when_it_is_back(forearm):
    node_id = int(forearm.scene.arm.node_id[forearm.reports[-1].contacts.patch[0]])
    before = forearm.reports[-1].ids.tolist()
    get = forearm.master.device.get
    forearm.patches.unplugged = {node_id}
    _, _, frames = forearm.run(100)
    said = [f.data for f in frames if f.can_id == CONTACT_IDS[0]]
    assert said[-1][1] >> 4 == ContactState.COAST
    assert get(0x3001, 10) >= 60  # ms since it was seen
    forearm.patches.unplugged = set()
    forearm.run(700)
    assert set(before) <= set(forearm.reports[-1].ids.tolist())
    assert get(0x3001, 28) == forearm.reports[-1].tracks.identity[0]
