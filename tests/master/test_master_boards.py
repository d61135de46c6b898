"""What differs between patches is data: an EDS that nobody has seen before, a DCF for each patch."""

import pytest

from skinbus.objects import cia
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
