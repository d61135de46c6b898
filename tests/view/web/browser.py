"""Debian's Chromium without a screen, with software rendering; what it fetched and what its console said."""

import shutil
from contextlib import contextmanager

import numpy as np

from tests.cli.patience import PATIENCE_S

CHROMIUM = shutil.which("chromium")
SIZE = {"width": 840, "height": 520}
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SOFTWARE += ["--disable-gpu-compositing"]  # as without a card: only what WebGL draws is drawn by SwiftShader


class Tab:
    """A page in the browser."""

    def __init__(self, page):
        self.page = page
        page.set_default_timeout(1e3 * PATIENCE_S)  # a busy machine may draw nothing for 30 s
        self.requests, self.errors = [], []
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("websocket", lambda socket: self.requests.append(socket.url))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda line: line.type == "error" and self.errors.append(line.text))

    def strangers(self, port):
        """Return what was fetched from elsewhere than the port of this machine."""
        here = tuple(f"{scheme}://127.0.0.1:{port}" for scheme in ("http", "ws", "blob:http"))
        return [url for url in self.requests if not url.startswith((*here, "data:"))]

    def close_alert(self):
        """Close what viser says to a browser without a graphics card."""
        alert = self.page.get_by_role("alert").get_by_role("button").first
        alert.click()
        alert.wait_for(state="detached")

    def picture(self):
        """Return the page as an array (height, width, 3) uint8."""
        from io import BytesIO

        from matplotlib.image import imread

        return np.round(255.0 * imread(BytesIO(self.page.screenshot()))[..., :3]).astype(int)


@contextmanager
def chromium():
    """Run the browser; yields what opens a tab at an address."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE, timeout=1e3 * PATIENCE_S)

        def open_tab(url, size=SIZE, *, dark=False):
            if size is SIZE:  # two that draw in software would wait for each other
                for page in [page for context in browser.contexts for page in context.pages]:
                    page.close()
            tab = Tab(browser.new_page(viewport=size, color_scheme="dark" if dark else "light"))
            tab.page.goto(url)
            return tab

        try:
            yield open_tab
        finally:
            browser.close()


def on_screen(camera, points, tab):
    """Return where points (n, 3) are in a picture of a tab, (n, 2) pixels from its upper left corner.

    ``camera`` is what the browser reported of its own.
    """
    box = tab.page.locator("canvas[data-engine]").bounding_box()
    forward = camera.look_at - camera.position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, camera.up_direction)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    away = points - camera.position
    focal = 0.5 * box["height"] / np.tan(0.5 * camera.fov) / (away @ forward)
    x = box["x"] + 0.5 * box["width"] + focal * (away @ right)
    y = box["y"] + 0.5 * box["height"] + focal * (away @ down)
    return np.stack([x, y], -1)
