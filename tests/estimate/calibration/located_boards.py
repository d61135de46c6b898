"""Arms whose boards sit elsewhere than planned, and presses at known places on them."""

import math
from dataclasses import replace

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate.calibration.table import Press
from skinbus.model import Arm
from tests.master.commissioning.person import Hand

HALF = 18e-3
"""m; presses lie within this of the centre of a board, along both of its sides."""

SURFACES = {
    "plane": 'surface = "plane"\nlength_mm = 320.0\nwidth_mm = 320.0\n',
    "cylinder": 'surface = "cylinder"\nlength_mm = 320.0\nradius_mm = 60.0\n',
    "cone": 'surface = "cone"\nlength_mm = 320.0\nradius_near_mm = 90.0\nradius_far_mm = 45.0\n',
}


def plan(folder, surface, n=20):
    """An arm with boards far enough apart for errors of mounting."""
    text = f'[arm]\nname = "plan"\nrate_hz = 20.0\n[[link]]\nname = "link"\n{SURFACES[surface]}'
    for k in range(n):
        row, column = divmod(k, 4)
        across = f"a_mm = {70.0 * column - 105.0}" if surface == "plane" else f"angle_deg = {90.0 * column}"
        text += f'[[patch]]\nlink = "link"\nnode_id = {k + 1}\ns_mm = {32.0 + 62.0 * row}\n{across}\n'
    path = folder / f"{surface}.toml"
    path.write_text(text)
    return path


def misplaced(arm, rng, place=3e-3, yaw=math.radians(3.0)):  # noqa: B008  a constant
    """The arm with each board moved and turned, uniformly within sqrt(3) sd so that none lies on another."""
    patches = []
    for placed in arm.patches:
        dx, dy, turn = np.sqrt(3.0) * rng.uniform(-1, 1, 3) * (place, place, yaw)
        s, a = arm.links[placed.link].surface.undevelop(placed.s + dx, dy, placed.a)
        patches.append(replace(placed, s=float(s), a=float(a), yaw=placed.yaw + turn))
    return Arm(arm.name, arm.links, patches, *arm.buses)


def pressed(true, seed, *, n=6, sd=0.3e-3, force=5.0, half=HALF):
    """Presses on each board, each at a place that is known up to an error of ``sd`` along both directions."""
    hand, rng = Hand(true, seed), np.random.default_rng(seed + 1)
    presses = []
    for p, placed in enumerate(true.patches):
        for uv in rng.uniform(-half, half, (n, 2)):
            both = [uv, uv + sd * rng.standard_normal(2)]
            (s, said_s), (a, said_a) = true.on_link(p, np.array(both))
            hand.scene.plan.touches = [(placed.link, float(s), float(a), force)]
            readings = np.mean([hand.pressures() for _ in range(5)], axis=0)[true.tactels_of(p)]
            presses.append(Press(p, float(said_s), float(said_a), force, readings))
    return presses


def errors(true, found):
    """Along s, across (m) and yaw (rad) of each located board, in the frame of its true place."""
    rows = []
    for board in found.boards:
        placed = true.patches[board.patch]
        surface = true.links[placed.link].surface
        x, y = surface.develop(board.s, board.a, placed.a)
        slant = surface.taper * float(surface.wrap(board.a - placed.a)) / surface.radius
        yaw = np.remainder(board.yaw + slant - placed.yaw + np.pi, 2.0 * np.pi) - np.pi
        rows.append((float(x) - placed.s, float(y), yaw))
    return np.array(rows)


def made(folder, surface, seed, **settings):
    """A plan, the arm as it is, and presses on it."""
    planned = load_arm(plan(folder, surface), check_load=False)
    true = misplaced(planned, np.random.default_rng(seed))
    return planned, true, pressed(true, seed, **settings)
