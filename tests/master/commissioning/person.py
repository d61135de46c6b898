"""A person with a fingertip: reads the lines of a dialogue, presses real boards, and makes mistakes."""

import math
import re
from dataclasses import replace

import numpy as np

from skinbus.model import Arm
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch, Touches

FORCE_N = 8.0
FINGER_MM = 12.0
NOISE_PA = 200.0


class HandPlan:
    """In the place of a scene's plan: what the hand presses at the moment."""

    def __init__(self, indenters):
        self.indenters = indenters
        self.loads = Loads(8)
        self.touches = []
        """(link, s, a, force)"""

    def load(self, t_s):
        loads = self.loads
        loads.n = len(self.touches)
        for k, (link, s, a, force) in enumerate(self.touches):
            loads.link[k], loads.s[k], loads.a[k], loads.force[k] = link, s, a, force
            loads.indenter[k], loads.radius[k] = 0, 0.5e-3 * FINGER_MM
        return loads

    def at(self, t_s):
        link, s, a, force = np.array(self.touches or np.zeros((0, 4))).T
        return Touches(link.astype(int), s, a, force, np.zeros(len(link), int))


def pressed_scene(arm, effects=()):
    """A scene on an arm whose touches are those of a hand."""
    never = Touch(
        link=0,
        path=np.array([[-2.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]),
        force=np.array([[-2.0, 0.0], [-1.0, 0.0]]),
        shape=Shape.DISC,
        length=1e-3 * FINGER_MM,
    )
    scene = Scene("hand", arm, duration_s=1e6, layer=Elastic(), touches=[never], effects=effects)
    scene.plan = HandPlan(scene.plan.indenters)
    return scene


def mounted(plan, seed):
    """The arm as it was mounted: boards in random order, off by a little, turned by quarters.

    Board k of the answer sits where patch k of the plan was to be.
    """
    rng = np.random.default_rng(seed)
    node_ids = rng.permutation(plan.node_id).tolist()
    serials = (rng.choice(1 << 31, plan.n_patches, replace=False) + 1).tolist()
    patches = []
    for placed, node_id, serial in zip(plan.patches, node_ids, serials, strict=True):
        (ds, da), yaw = 3e-3 * rng.standard_normal(2), 0.5 * math.pi * rng.integers(4)
        place = {"s": placed.s + ds, "a": placed.a + da, "yaw": placed.yaw + yaw}
        patches.append(replace(placed, node_id=node_id, serial=serial, **place))
    return Arm(plan.name, plan.links, patches, *plan.buses)


class Hand:
    """Pressures of an arm under a hand, without a bus."""

    def __init__(self, arm, seed):
        self.arm = arm
        self.scene = pressed_scene(arm)
        self.rng = np.random.default_rng(seed)
        self.offset = np.zeros(arm.n_tactels)
        """Pa, zeros that lie elsewhere than the files say."""
        geometry = Geometry.of(arm, discs=True)
        self._law = self.scene.layer.bind(geometry, self.scene.plan.indenters)

    def pressures(self):
        pressures = np.zeros(self.arm.n_tactels)
        self._law.add(self.scene.plan.load(0.0), pressures)
        return pressures + self.offset + NOISE_PA * self.rng.standard_normal(len(pressures))


ASKED = re.compile(r"\[(\d+)/\d+\] .*: press the centre\.$")


class Person:
    """Does what the newest line asks for, on the boards as they are mounted; off by 2 mm or so."""

    def __init__(self, arm, seed):
        self.arm = arm
        self.rng = np.random.default_rng(seed)

    def aim(self, line):
        """Where a line asks to press: link, s, a."""
        return self.point(int(ASKED.search(line)[1]) - 1)

    def point(self, p, off=(0.0, 0.0)):
        """Where the centre of the board at a place is, or a point off it: link, s, a."""
        placed = self.arm.patches[p]
        x, y = off + 2e-3 * self.rng.standard_normal(2)
        surface = self.arm.links[placed.link].surface
        s, a = surface.undevelop(placed.s + x, y, placed.a)
        return placed.link, float(s), float(a)
