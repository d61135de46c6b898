"""The pictures of docs/view.md: scenes made up to a moment with several contacts, in a browser.

python -m tests.view.web.figures
"""

import time
from contextlib import closing
from pathlib import Path

from skinbus.sim import load_scene
from skinbus.skin.simulated import simulate
from skinbus.view.web.page import Page
from tests.view.web.browser import chromium
from tests.view.web.shown import Fixed

ROOT = Path(__file__).resolve().parents[3]
GRASP = ROOT / "tests" / "view" / "web" / "grasp.toml"
WIDE, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 760}
SETTLE_S = 20.0
"""Of a browser that draws without a graphics card."""


def picture(open_tab, name, scene, until_s, size, tab_name="Forces", dark=False):
    """Store the page of a scene as it is at a time."""
    loaded = load_scene(scene)
    with simulate(loaded, zero=True) as skin:
        source = Fixed(next(skin))
        with closing(Page(loaded.arm, source, f"scene {Path(scene).stem}", port=0, dark=dark)) as page:
            for cycle in skin:
                source.newest, source.n_cycles = cycle, cycle.number
                source.history.take(cycle)
                page.update()
                if cycle.t_ns > 1e9 * until_s:
                    break
            tab = open_tab(f"{page.server.link}&fixedDpr=1", size, dark=dark)
            tab.close_alert()
            tab.page.get_by_role("tab", name=tab_name).click()
            if size is PHONE:
                tab.page.get_by_text("skinbus", exact=True).click()  # folds the panel
            page._panel_s = 0.0
            page.update()
            time.sleep(SETTLE_S)
            tab.page.screenshot(path=ROOT / "docs" / "figures" / name)


if __name__ == "__main__":
    with chromium() as open_tab:
        picture(open_tab, "view-forearm.png", str(GRASP), 3.0, WIDE)
        picture(open_tab, "view-arm-dark.png", "arm", 4.0, WIDE, "Boards", dark=True)
        picture(open_tab, "view-phone.png", str(GRASP), 3.0, PHONE)
