"""The page in a browser: what is on it is where it is on the arm, and nothing leaves this machine."""

import threading
import time

import numpy as np
import pytest

from skinbus.sim import load_scene
from skinbus.skin.simulated import simulate
from skinbus.view.web import colours
from skinbus.view.web.follower import Follower
from skinbus.view.web.page import Page, Settings
from tests.view.web.browser import CHROMIUM, chromium, on_screen

SCENE = """
[scene]
arm = "forearm"
duration_s = 600.0
[[touch]]
link = "forearm"
s_mm = 76.0
angle_deg = -43.0
shape = "disc"
diameter_mm = 12.0
force_n = 6.0
start_s = 0.8
end_s = 600.0
[effect.patch_silent]
nodes = [8]
from_s = 0.7
"""
"""A finger that stays on the side of the arm that the camera sees, and a lost board in its view."""

TOUCHED = 0.076, -np.radians(43.0) * 0.0649352
PRESSED_BOARD, QUIET_BOARD, LOST_BOARD = 15, 14, 7

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


class Shown:
    """A page, served from a thread."""

    def __init__(self, opening, arm):
        self.arm = arm
        self.follower = Follower(opening)
        self.page = Page(arm, self.follower, "test", Settings(port=0))
        self._thread = threading.Thread(target=self.page.run)
        self._thread.start()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.page.port}/"

    def close(self):
        self.page.stop()
        self._thread.join()
        self.page.close()
        self.follower.close()


def eventually(holds, seconds=40.0, told=None):
    """Wait until something holds; the browser has its own time."""
    end = time.monotonic() + seconds
    while not (answer := holds()):
        assert time.monotonic() < end, f"it never held: {told}"
        time.sleep(0.05)
    return answer


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "scene.toml"
    path.write_text(SCENE)
    scene = load_scene(str(path))
    shown = Shown(lambda: simulate(scene, realtime=True, zero=True), scene.arm)
    yield shown
    shown.close()


@pytest.fixture(scope="module")
def open_tab():
    with chromium() as opening:
        yield opening


@pytest.fixture(scope="module")
def tab(shown, open_tab):
    """The page in a tab; one for all tests, as a browser without a graphics card is slow."""
    return open_tab(shown.url)


def seen_colour(picture, at):
    """Return the colour around a place: the median of a few pixels."""
    x, y = np.round(at).astype(int)
    return np.median(picture[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3), axis=0)


def test_browser_shows_pressures_contact_and_lost_board_where_they_are(shown, tab):
    page, arm = shown.page, shown.arm
    eventually(lambda: page.drawing and len(page.drawing.labels) == 1 and page.drawing.n_lost == 1)
    tab.page.get_by_text("live").wait_for()
    (label,) = page.drawing.labels
    ((tail, head),) = page.drawing.forces.points
    point, _ = arm.links[0].surface.position(TOUCHED[0], TOUCHED[1])
    assert np.linalg.norm(head - point) < 0.004
    assert np.linalg.norm(tail - head) == pytest.approx(0.06, rel=0.1)
    assert label.text == "1: 6.0 N"

    ((_, client),) = eventually(lambda: page.clients.items() if page.clients else None)
    surface = arm.links[0].surface
    points, _ = surface.position(arm.tactel_s, arm.tactel_a)
    places = on_screen(client.camera, points, tab)
    pressures = shown.follower.newest.readings.pressures
    near = np.flatnonzero(arm.tactel_patch == PRESSED_BOARD)
    pressed = near[pressures[near].argsort()[-6:-2]]  # the arrow may hide the nearest
    quiet = np.flatnonzero(arm.tactel_patch == QUIET_BOARD)

    lost = np.flatnonzero(arm.tactel_patch == LOST_BOARD)
    centre = surface.position(arm.patch_s[LOST_BOARD], arm.patch_a[LOST_BOARD])[0]
    cross = on_screen(client.camera, centre[None], tab)[0]

    wanted = colours.shades(pressures)
    seen = {}

    def is_drawn():
        picture = tab.picture()
        seen["off"] = [np.abs(seen_colour(picture, places[t]) - wanted[t]).max() for t in [*pressed, *quiet]]
        x, y = np.round(cross).astype(int)
        red, green, blue = np.moveaxis(picture[y - 8 : y + 8, x - 8 : x + 8], -1, 0)
        seen["crossed"] = ((red > 150) & (green < 110) & (blue < 110)).sum()
        grey = [np.abs(seen_colour(picture, places[t]) - colours.UNKNOWN).max() for t in lost[[1, 2, 4, 7]]]
        seen["grey"] = max(grey)
        return max(seen["off"]) < 40 and seen["crossed"] > 4 and seen["grey"] < 40

    eventually(is_drawn, told=seen)
    assert tab.errors == []
    assert tab.strangers(page.port) == []


def test_zero_all_makes_what_is_read_now_the_zero(shown, tab):
    eventually(lambda: shown.follower.newest and shown.follower.newest.contacts)
    tab.page.get_by_role("button", name="Zero all").click()
    tab.page.get_by_text("zero all: done").wait_for()
    eventually(lambda: np.abs(shown.follower.newest.readings.pressures).max() < 3000.0)
    assert tab.errors == []
