"""The screen of a running master says what the contact TPDOs say."""

from skinbus.cli.live import Screen, rows_of
from skinbus.objects.contacts import ContactState, unpack_contacts
from tests.master.rig import Rig

CONTACT_IDS = range(0x681, 0x691)


def test_rows_say_what_the_contact_pdos_say():
    rig = Rig("pad")
    (node_id,) = rig.scene.arm.node_id.tolist()
    published = []
    screen = Screen(rig.scene.arm)
    for blind in (False, True, False):  # for a moment nobody knows whether the touch is still there
        rig.patches.unplugged = {node_id} if blind else set()
        cycles, _, frames = rig.run(60 if blind else 2500)
        shown = [(row.id, row.state, round(row.force, 2)) for cycle in cycles for row in rows_of(cycle)]
        told = [unpack_contacts(frame.data) for frame in frames if frame.can_id in CONTACT_IDS]
        told = [(int(c.id[0]), ContactState(int(c.state[0])), round(float(c.force[0]), 2)) for c in told]
        assert shown == told
        published += told
    assert {state for _, state, _ in published} == set(ContactState) - {ContactState.NONE}
    assert screen.render(cycles[-1]).renderables
