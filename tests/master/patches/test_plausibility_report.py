"""A tactel that cannot be right, on the bus: no contact of its own, and it is named."""

import numpy as np

from skinbus.estimate import Quality, TactelFault
from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import PATCH_FAULTY, PATCH_FAULTY_COUNT, index_of
from skinbus.sim.scene_file import SCENES
from tests.files import put
from tests.master.rig import Rig

OD = load_eds("skin-master", 127)
NODE, TACTEL = 1, 11


def test_tactel_at_full_scale_is_no_contact_and_one_beside_it_says_so(tmp_path):
    rig = Rig(put(tmp_path, "scene.toml", (SCENES / "pad.toml").read_text() + "[effect.noise]\n"))
    rig.run(600)
    at_rail = lambda tpdo, counts: np.where(4 * tpdo + np.arange(4) == TACTEL - 1, 32752, counts)  # noqa: E731
    rig.patches.changes[NODE] = at_rail
    reports, _, frames = rig.run(1500)
    said = [tuple(f.data) for f in frames if f.can_id == cia.EMCY_BASE + 127]
    code = tuple(cia.EmcyCode.DEVICE_SPECIFIC.to_bytes(2, "little"))
    assert [data[3:7] for data in said if data[:2] == code] == [(NODE, TACTEL, TactelFault.RAIL, 1)]
    shown = [
        index_of(OD, "Cycle/Implausible tactels"),
        *((index_of(OD, name)[0], NODE) for name in (PATCH_FAULTY, PATCH_FAULTY_COUNT)),
    ]
    assert [rig.master.device.get(*entry) for entry in shown] == [1, 1 << TACTEL - 1, 1]
    for report in reports[-25:]:
        (quality,) = report.contacts.quality  # the finger alone
        assert quality & Quality.IMPAIRED
