"""Pictures of the page: those of docs/view.md, and the stored one that a test compares with."""

import time
from contextlib import closing
from pathlib import Path

import numpy as np
from matplotlib.image import imread, imsave

from skinbus.master.patches.table import PatchState
from skinbus.sim import load_scene
from skinbus.skin.simulated import simulate
from tests.view.web.cycles import ARM, MadeCycle
from tests.view.web.shown import Fixed, Shown

ROOT = Path(__file__).resolve().parents[3]

STORED = ROOT / "tests" / "golden" / "page.png"
BLOCK, WIDTH = 8, 448
"""Pixels of a side of a block of the stored picture, and of its width: the arm without the panels."""
DESKTOP = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}


def cycles_of(scene, seconds):
    """Return the cycles of a scene up to a time: the same picture each time."""
    n = round(seconds * scene.arm.bus.rate_hz)
    with simulate(scene, zero=True) as skin:
        return [cycle for cycle, _ in zip(skin, range(n), strict=False)]


PICTURES = {
    "view-forearm": ("forearm", 4.2, DESKTOP, False, "Forces"),
    "view-arm-dark": ("arm", 4.0, DESKTOP, True, "Boards"),
    "view-phone": ("forearm", 4.2, PHONE, False, None),
}
"""Scene, time, size, whether it is dark, and the tab that is open."""


def all_ways():
    """Return the pictures to look at: two scenes, wide and narrow, light and dark."""
    return {
        f"view-{what}-{side}-{shade}": (what, 4.0, size, shade == "dark", tab)
        for what, tab in (("forearm", "Loads"), ("arm", "Boards"))
        for side, size in (("wide", DESKTOP), ("narrow", PHONE))
        for shade in ("light", "dark")
    }


def make(open_tab, what, seconds, size, dark, tab_name, out):
    """Make one picture."""
    scene = load_scene(what)
    follower = Fixed(*cycles_of(scene, seconds))
    with closing(Shown(follower, scene.arm, f"scene {what}", dark=dark)) as shown:
        tab = open_tab(f"{shown.url}?fixedDpr=1", size)
        time.sleep(6.0)
        tab.close_alert()
        if size is PHONE:
            tab.page.get_by_text("skinbus", exact=True).first.click()  # folds the sheet
        elif tab_name:
            tab.page.get_by_role("tab", name=tab_name).click()
        time.sleep(4.0)
        tab.page.screenshot(path=out)
        tab.page.close()


def stored_cycle(number=1):
    """Return a cycle of the stored picture."""
    contacts = [
        {"id": 1, "s": 0.076, "a": -0.05, "force": 6.0},
        {"id": 2, "s": 0.03, "a": -0.09, "force": 2.0},
    ]
    pressures = np.linspace(0.0, 30e3, ARM.n_tactels)
    lost = {7: PatchState.SILENT, 13: PatchState.BOOTING}
    return MadeCycle(number, contacts, pressures=pressures, states=lost)


def in_blocks(picture):
    """Return the mean colours of the blocks of a picture."""
    height, width = (n // BLOCK for n in picture.shape[:2])
    cut = picture[: BLOCK * height, : BLOCK * width].reshape(height, BLOCK, width, BLOCK, 3)
    return cut.mean((1, 3))


def stored():
    """Return the stored picture in blocks."""
    return np.round(255.0 * imread(STORED)[..., :3])


def store(open_tab):
    """Make the stored picture."""
    with closing(Shown(Fixed(stored_cycle()), ARM)) as shown:
        tab = open_tab(shown.url)
        tab.close_alert()
        time.sleep(8.0)
        imsave(STORED, np.round(in_blocks(tab.picture()[:, :WIDTH])).astype(np.uint8))
