"""Boards whose places are not known are read, and no contact is published of them."""

import numpy as np

from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.arm_file import find_arm
from skinbus.config.system import load_arm
from skinbus.master.commissioning.scan import Found
from skinbus.master.commissioning.unplaced_boards import QuietMaster, kinds_of, unplaced
from skinbus.objects.published import usual
from skinbus.sim import World
from tests.files import put
from tests.master.commissioning.person import FORCE_N, Person, mounted, pressed_scene

MS = 1_000_000
SEED = 20261124


def node(node_id, kind, **numbers):
    names = ("device_type", "vendor", "product")
    return Found(node_id, answers=True, numbers=dict(zip(names, kind, strict=True)) | numbers)


def test_a_press_is_read_and_no_contact_is_published(tmp_path):
    text = find_arm("pad").read_text() + 'set = { "Touch Pa" = 1500 }'
    pad = load_arm(put(tmp_path, "pad.toml", text))
    arm = mounted(pad, SEED)
    scene = pressed_scene(arm)
    wire, frames, cycles = VirtualBus(), [], []
    wire.attach(World(scene))
    wire.tap(frames.append)
    (kind,) = kinds_of(pad)
    bench = unplaced([node(9, kind.kind, product=0x1234), node(1, kind.kind)], pad)
    assert (bench.arm.node_id.tolist(), bench.strangers) == ([1], [9])
    assert bench.arm.patches[0].settings  # else what the board has stored would be lost
    wire.attach(QuietMaster(bench.arm, lambda t_ns, pressures: cycles.append(pressures)))
    wire.run(1000 * MS)
    scene.plan.touches = [(*Person(arm, SEED).point(0), FORCE_N)]
    wire.run(2000 * MS)
    assert np.nanmax(cycles[-1]) > 10e3
    said = usual()
    untold = {*said.contact_ids, said.summary.cob_id, said.load.cob_id}
    assert not untold & {frame.can_id for frame in frames}
    assert len(cycles) > 20
