"""Makes the pictures of docs/view.md anew with Chromium: python -m tests.view.web.pictures [NAME ...]"""

import sys
import threading
import time

from skinbus.sim import load_scene
from skinbus.skin.simulated import simulate
from skinbus.view.web.history import History
from skinbus.view.web.page import Page, Settings
from tests.imports import ROOT
from tests.view.web.browser import chromium

FIGURES = ROOT / "docs" / "figures"
DESKTOP = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}


class Still:
    """What a follower has of a scene at one time: the same picture each time."""

    silent_s, error, has_ended = 0.0, None, False

    def __init__(self, scene, seconds):
        self.history, self.newest, self.n_cycles = History(), None, 0
        skin = simulate(scene, zero=True)
        for cycle in skin:
            self.history.take(cycle)
            self.newest, self.n_cycles = cycle, self.n_cycles + 1
            if cycle.number >= seconds * scene.arm.bus.rate_hz:
                break
        skin.close()

    def zero(self, patch):
        """Do nothing."""


PICTURES = {
    "view-forearm": ("forearm", 4.2, DESKTOP, False, "Forces"),
    "view-arm-dark": ("arm", 4.0, DESKTOP, True, "Boards"),
    "view-phone": ("forearm", 4.2, PHONE, False, None),
}
"""Scene, time, size, whether it is dark, and the tab that is open."""


def make(open_tab, name):
    """Make one picture."""
    what, seconds, size, dark, tab_name = PICTURES[name]
    scene = load_scene(what)
    page = Page(scene.arm, Still(scene, seconds), f"scene {what}", Settings(port=0, dark=dark))
    thread = threading.Thread(target=page.run)
    thread.start()
    try:
        tab = open_tab(f"http://127.0.0.1:{page.port}/", size, full=True)
        time.sleep(6.0)
        close = tab.page.get_by_role("alert").get_by_role("button")
        if close.count():
            close.first.click()
        if size is PHONE:
            tab.page.get_by_text("skinbus", exact=True).first.click()  # folds the sheet
        if tab_name:
            tab.page.get_by_role("tab", name=tab_name).click()
        time.sleep(4.0)
        tab.page.screenshot(path=FIGURES / f"{name}.png")
        tab.page.close()
    finally:
        page.stop()
        thread.join()
        page.close()


if __name__ == "__main__":
    with chromium() as opening:
        for wanted in sys.argv[1:] or PICTURES:
            make(opening, wanted)
