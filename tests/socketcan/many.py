"""An arm with as many patches as a bus can name, and presses on it."""

import math

from tests.files import put

ARM = """
[arm]
name = "many"
rate_hz = {rate_hz}
[[link]]
name = "tube"
surface = "cylinder"
length_mm = 470.0
radius_mm = {radius:.3f}
"""
RING = '[[ring]]\nlink = "tube"\ns_mm = {s}\ncount = {count}\nfirst_node_id = {first}\n'
SCENE = '[scene]\ntitle = "presses"\narm = "{arm}"\nduration_s = 1000.0\n'
TOUCH = (
    '[[touch]]\nlink = "{link}"\ns_mm = {s}\nangle_deg = 10.0\nforce_n = 6.0\nstart_s = 0.0\nend_s = 1000.0\n'
)


def many_patches(folder, rate_hz=10.0):
    """126 patches on one tube, and a scene with four presses."""
    text = ARM.format(rate_hz=rate_hz, radius=14 * 51.5 / (2 * math.pi))
    text += "".join(RING.format(s=26 + 52 * ring, count=14, first=1 + 14 * ring) for ring in range(9))
    put(folder, "many.toml", text)
    scene = SCENE.format(arm=folder / "many.toml")
    scene += "".join(TOUCH.format(link="tube", s=s) for s in (30, 130, 230, 330))
    return str(folder / "many.toml"), str(put(folder, "scene.toml", scene))
