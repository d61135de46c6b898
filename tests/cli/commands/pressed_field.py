"""A field: presses on the pad that were recorded, what the robot logged, and the truth."""

from contextlib import closing

import numpy as np

from skinbus.can.candump import CandumpWriter
from tests.files import put
from tests.master.rig import Rig

SHIFT_S = 17.25
"""The clock of the robot less that of the skin."""
PLACE_MM, FORCE = 0.1, 0.01
"""Errors of what the robot and the force sensor say: mm, and a part."""


def make_field(folder, n, seed, arm="pad", effects="[effect.noise]"):
    """Write field.log, robot.csv, xyz.csv; return begins, ends, s, a and forces of the presses."""
    rng = np.random.default_rng(seed)
    begin, lines, truth = 1.0, [], []
    for _ in range(n):
        s, a, newton = rng.uniform(12.0, 38.0), rng.uniform(-13.0, 13.0), rng.uniform(4.0, 10.0)
        end = begin + rng.uniform(0.4, 0.6)
        lines.append(
            f'[[touch]]\nlink = "plate"\ns_mm = {s}\na_mm = {a}\nshape = "disc"\ndiameter_mm = 8.0\n'
            f"force_n = {newton}\nramp_s = 0.03\nstart_s = {begin}\nend_s = {end}\n"
        )
        truth.append((begin, end, s, a, newton))
        begin = end + rng.uniform(0.3, 0.5)
    head = f'[scene]\narm = "{arm}"\nduration_s = {begin + 0.3}\n{effects}\n'
    rig = Rig(str(put(folder, "presses.toml", head + "".join(lines))), level="kmeans")
    with closing(CandumpWriter(folder / "field.log")) as writer:
        rig.wire.tap(lambda frame: writer.write([frame]))
        rig.run(1e3 * (begin + 0.3))
    t = np.arange(0.0, begin, 0.008)
    truth = np.array(truth)
    edges = np.sort(np.concatenate([truth[:, 0] - 0.03, truth[:, 1] + 0.03]))
    s, a = (np.interp(t, edges, np.repeat(truth[:, k], 2)) for k in (2, 3))
    pressing = np.clip(np.minimum(t[:, None] - truth[:, 0], truth[:, 1] - t[:, None]) / 0.03, 0.0, 1.0)
    force = (pressing * truth[:, 4]).sum(axis=1) * (1.0 + FORCE * rng.standard_normal())
    height = 20.0 * (pressing.sum(axis=1) == 0.0)
    offset = PLACE_MM * rng.standard_normal((2, 1))
    places = np.array([s, a]) + offset
    write(folder / "robot.csv", "t_s,s_mm,a_mm,height_mm,force_n", t + SHIFT_S, *places, height, force)
    write(folder / "xyz.csv", "t_s,x_mm,y_mm,z_mm", t + SHIFT_S, s, a, height)
    return truth


def write(path, head, *columns):
    """Write columns as a table."""
    np.savetxt(path, np.column_stack(columns), fmt="%.5f", delimiter=",", header=head, comments="")
