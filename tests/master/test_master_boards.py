"""What differs between patches is data: an EDS that nobody has seen before, a DCF for each patch."""

import numpy as np
import pytest

from skinbus.objects import cia
from skinbus.objects.dcf import write_dcf
from skinbus.objects.eds import find_eds
from tests.master.rig import Rig

TOUCH = (0x2030, 1)
GAIN = 0x2011
TRUTH = {"s_mm": 31.0, "a_mm": -6.0, "force_n": 5.0}


def scene_of(folder, patches, length_mm=50.0):
    """A plate with these patches, pressed by a fingertip on the first of them."""
    arm, scene = folder / "arm.toml", folder / "scene.toml"
    arm.write_text(
        f'[arm]\nname = "plate"\nrate_hz = 50.0\n[[link]]\nname = "plate"\nsurface = "plane"\n'
        f"length_mm = {length_mm}\nwidth_mm = 50.0\n" + "".join(f"[[patch]]\n{text}\n" for text in patches)
    )
    scene.write_text(
        f'[scene]\ntitle = "a fingertip"\narm = "{arm}"\nduration_s = 60.0\n'
        '[[touch]]\nlink = "plate"\nshape = "disc"\ndiameter_mm = 10.0\nstart_s = 0.2\nend_s = 50.0\n'
        + "".join(f"{key} = {value}\n" for key, value in TRUTH.items())
    )
    return scene


@pytest.fixture
def strange_eds(tmp_path):
    """An EDS that skinbus has never seen: another maker, another product, 64 tactels."""
    text = find_eds("skin-patch-8x8").read_text()
    text = text.replace("0x534B4E42", "0x00ABCDEF").replace("0x00005003", "0x00007777")
    path = tmp_path / "their-board.eds"
    path.write_text(text.replace("skin patch 8 x 8, 8 bit", "board of somebody else"))
    return path


def test_8_by_8_patch_described_by_nothing_but_a_new_eds_works_end_to_end(tmp_path, strange_eds):
    rig = Rig(scene_of(tmp_path, [f'node_id = 9\nlink = "plate"\ns_mm = 25.0\neds = "{strange_eds.name}"']))
    rig.run(1500)
    report = rig.reports[-1]
    assert rig.master.arm.n_tactels == 64
    assert rig.device(9).get(cia.IDENTITY, cia.IDENTITY_VENDOR) == 0xABCDEF
    assert report.n_fresh == 1
    contacts = report.contacts
    assert len(contacts) == 1
    # The centroid of the paper on a grid of 6 mm and the elastic layer of the simulator: 2 mm, 40 % of force.
    assert 1e3 * contacts.s[0] == pytest.approx(TRUTH["s_mm"], abs=2.0)
    assert 1e3 * contacts.a[0] == pytest.approx(TRUTH["a_mm"], abs=2.0)
    assert contacts.force[0] == pytest.approx(TRUTH["force_n"], rel=0.4)


GAINS = {4: 1.0 + 0.01 * np.arange(16), 5: 1.2 - 0.02 * np.arange(16)}


@pytest.fixture
def two_dcfs(tmp_path):
    """Two patches, each with a DCF: other thresholds, other gains, another law."""
    for node_id, gains in GAINS.items():
        values = {(GAIN, k + 1): float(gain) for k, gain in enumerate(gains)}
        values |= {TOUCH: 1000 + node_id, (0x2020, 1): 0, (0x2020, 2): 1e6 * node_id}
        write_dcf("skin-patch", tmp_path / f"patch{node_id}.dcf", values, node_id=node_id)
    patches = [
        f'node_id = {node_id}\nlink = "plate"\ns_mm = {s_mm}\neds = "patch{node_id}.dcf"'
        for node_id, s_mm in ((4, 27.0), (5, 80.0))
    ]
    return scene_of(tmp_path, patches, length_mm=110.0)


def test_dcf_of_each_patch_is_downloaded_and_the_master_calibrates_with_it(two_dcfs):
    rig = Rig(two_dcfs)
    rig.run(1500)
    for node_id, gains in GAINS.items():
        device = rig.device(node_id)
        held = [device.get(GAIN, k) for k in range(1, 17)]
        np.testing.assert_allclose(held, gains, rtol=1e-6)
        assert device.get(*TOUCH) == 1000 + node_id
        placed = rig.master.arm.patches[rig.master.arm.patch_at(node_id)].patch
        assert placed.law.slope == 1e6 * node_id
        assert placed.threshold == 1000 + node_id
    assert rig.reports[-1].n_fresh == 2
    plan, counts = rig.master.gather.plan, rig.master.gather.counts
    gains = np.concatenate(list(GAINS.values()))
    wanted = (counts - plan.counts_offset) * plan.counts_scale * gains
    np.testing.assert_allclose(rig.reports[-1].pressures, wanted, rtol=1e-6)
    contacts = rig.reports[-1].contacts
    assert len(contacts) == 1
    assert 1e3 * contacts.s[0] == pytest.approx(TRUTH["s_mm"], abs=3.0)
