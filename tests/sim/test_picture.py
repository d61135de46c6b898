"""Pictures: drawn for every kind of surface and indenter, and boards are where the arm says."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.model import Surface
from skinbus.sim import load_scene
from skinbus.sim.picture import outline, save_picture

PNG = b"\x89PNG\r\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pad", "arm", "everything"])
def test_picture_of_a_scene_is_a_png_of_some_size(tmp_path, name):
    path = tmp_path / "scene.png"
    save_picture(load_scene(name), path)
    data = path.read_bytes()
    assert data.startswith(PNG)
    assert len(data) > 10_000


@pytest.mark.slow
def test_outline_of_a_board_has_its_size_and_holds_its_tactels():
    arm = load_arm("arm")
    for p, placed in enumerate(arm.patches):
        surface: Surface = arm.links[placed.link].surface
        s, a = outline(surface, placed).T
        x, y = surface.develop(s, a, placed.a)
        area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
        assert area == pytest.approx(0.050**2, rel=1e-6), "a board is bent, not stretched"
        at = arm.tactels_of(p)
        tx, ty = surface.develop(arm.tactel_s[at], arm.tactel_a[at], placed.a)
        assert tx.min() > x.min()
        assert ty.max() < y.max()


def test_without_matplotlib_the_fault_says_what_to_install(tmp_path, monkeypatch):
    import sys

    from skinbus.errors import SkinbusError

    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(SkinbusError, match=r"pip install skinbus\[figures\]"):
        save_picture(load_scene("pad"), tmp_path / "scene.png")
