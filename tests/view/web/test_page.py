"""The page in a browser: what is on it is where it is on the arm, and nothing leaves this machine."""

from pathlib import Path

import numpy as np
import pytest

from skinbus.sim import load_scene
from skinbus.skin.simulated import simulate
from skinbus.view.web import colours
from skinbus.view.web.follower import Follower
from tests.cli.patience import wait_until
from tests.files import put
from tests.view.web import cycles
from tests.view.web.browser import CHROMIUM, chromium, on_screen
from tests.view.web.shown import Fixed, Shown

ROOT = Path(__file__).resolve().parents[3]

SCENE = """
[scene]
arm = "slow.toml"
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
"""A finger that stays on the side of the arm that the camera sees, and a lost board in its view; at 10 Hz:
drawing without a graphics card leaves little time to simulate."""

PRESSED_BOARD, QUIET_BOARD, LOST_BOARD = 15, 14, 7

PICTURE_S = 1.0
"""Between two pictures of a tab: each makes it draw, and one that only draws comes to nothing else."""
PIXELS = """() => {
  const canvas = document.querySelector("canvas[data-engine]");
  return [canvas.width, canvas.clientWidth];
}"""

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    arm = (ROOT / "skinbus" / "config" / "arms" / "forearm.toml").read_text()
    assert "rate_hz = 50.0" in arm
    put(folder, "slow.toml", arm.replace("rate_hz = 50.0", "rate_hz = 10.0"))
    scene = load_scene(str(put(folder, "scene.toml", SCENE)))
    shown = Shown(Follower(lambda: simulate(scene, realtime=True, zero=True)), scene.arm)
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


@pytest.mark.slow
def test_browser_shows_pressures_contact_and_lost_board_where_they_are(shown, tab):
    page, arm = shown.page, shown.arm
    wait_until(lambda: page.drawing and len(page.drawing.labels) == 1 and len(page.drawing.boards.points))
    tab.page.get_by_text("live").wait_for(state="attached")
    (label,) = page.drawing.labels
    assert label.text == "1: 6.0 N"
    ((_, client),) = wait_until(lambda: page.server.get_clients().items())
    surface = arm.links[0].surface
    points, _ = surface.position(arm.tactel_s, arm.tactel_a)
    places = on_screen(client.camera, points, tab)
    pressures = shown.source.newest.readings.pressures
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
        off = [np.abs(seen_colour(picture, places[t]) - wanted[t]).max() for t in [*pressed, *quiet]]
        seen["off"] = [*sorted(off[: len(pressed)])[:-1], *off[len(pressed) :]]  # the label may hide one
        x, y = np.round(cross).astype(int)
        red, green, blue = np.moveaxis(picture[y - 8 : y + 8, x - 8 : x + 8], -1, 0)
        seen["crossed"] = ((red > 150) & (green < 110) & (blue < 110)).sum()
        grey = [np.abs(seen_colour(picture, places[t]) - colours.UNKNOWN).max() for t in lost[[1, 2, 4, 7]]]
        seen["grey"] = max(grey)
        return max(seen["off"]) < 40 and seen["crossed"] > 4 and seen["grey"] < 40

    wait_until(is_drawn, PICTURE_S)
    drawn, shown_on = tab.page.evaluate(PIXELS)
    assert drawn == pytest.approx(0.5 * shown_on, abs=1)  # a quarter of the pixels without a graphics card
    assert tab.errors == []
    assert tab.strangers(page.server.get_port()) == []


@pytest.fixture(scope="module")
def scripted():
    """A page of two contacts, a slope of pressures, a lost and a booting board, that stays as it is."""
    shown = Shown(Fixed(cycles.busy_cycle()), cycles.ARM)
    yield shown
    shown.close()


@pytest.fixture(scope="module")
def scripted_tab(scripted, open_tab):
    tab = open_tab(scripted.url)
    tab.close_alert()
    return tab


@pytest.mark.slow
def test_page_says_that_the_bus_is_gone_and_goes_on_when_it_is_back(scripted, scripted_tab):
    follower, tab = scripted.source, scripted_tab
    tab.page.get_by_text("live").wait_for(state="attached")
    follower.silent_s = 5.0
    tab.page.get_by_text("bus or master is gone").wait_for(state="attached")
    assert scripted.page.drawing.labels == ()
    assert all((tints == colours.UNKNOWN).all() for tints in scripted.page.drawing.tactels)
    follower.silent_s = 0.0
    tab.page.get_by_text("live").wait_for(state="attached")
    assert len(scripted.page.drawing.labels) == 2
    assert tab.errors == []
