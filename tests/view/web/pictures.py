"""The stored picture of the page that a test compares with."""

import time
from contextlib import closing
from pathlib import Path

import numpy as np
from matplotlib.image import imread, imsave

from skinbus.master.patches.table import PatchState
from tests.view.web.cycles import ARM, made_cycle
from tests.view.web.shown import Fixed, Shown

ROOT = Path(__file__).resolve().parents[3]

STORED = ROOT / "tests" / "golden" / "page.png"
BLOCK, WIDTH = 8, 448
"""Pixels of a side of a block of the stored picture, and of its width: the arm without the panels."""


def stored_cycle(number=1):
    """Return a cycle of the stored picture."""
    contacts = [
        {"id": 1, "s": 0.076, "a": -0.05, "force": 6.0},
        {"id": 2, "s": 0.03, "a": -0.09, "force": 2.0},
    ]
    pressures = np.linspace(0.0, 30e3, ARM.n_tactels)
    lost = {7: PatchState.SILENT, 13: PatchState.BOOTING}
    return made_cycle(number, contacts, pressures=pressures, states=lost)


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
