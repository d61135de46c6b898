"""A scene of a second on the arm "pad": a touch that slides."""

from tests.files import put

SLIDE = """
[scene]
arm = "pad"
duration_s = 1.0
[[touch]]
link = "plate"
path = [[0.3, 15.0, 0.0], [0.7, 35.0, 0.0]]
shape = "disc"
diameter_mm = 10.0
force_n = 5.0
start_s = 0.3
end_s = 0.7
"""


def write(folder):
    return str(put(folder, "slide.toml", SLIDE))
