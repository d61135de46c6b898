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


def mounted(plan, seed, *, place_mm=3.0, yaw_deg=3.0, n_mirrored=2):
    """The arm as it was mounted: boards in random order, turned by quarters, off by a little, some mirrored.

    Board k of the answer sits where patch k of the plan was to be.
    """
    rng = np.random.default_rng(seed)
    node_ids = rng.permutation(plan.node_id)
    serials = rng.choice(1 << 31, plan.n_patches, replace=False) + 1
    mirrored = np.isin(np.arange(plan.n_patches), rng.permutation(plan.n_patches)[:n_mirrored])
    patches = []
    for k, placed in enumerate(plan.patches):
        ds, da = 1e-3 * place_mm * rng.standard_normal(2)
        yaw = 0.5 * math.pi * rng.integers(4) + math.radians(yaw_deg) * rng.standard_normal()
        patch = placed.patch.mirrored() if mirrored[k] else placed.patch
        patches.append(
            replace(
                placed,
                patch=patch,
                node_id=int(node_ids[k]),
                serial=int(serials[k]),
                s=placed.s + ds,
                a=placed.a + da,
                yaw=math.remainder(placed.yaw + yaw, math.tau),
            )
        )
    return Arm(plan.name, plan.links, patches, *plan.buses), mirrored


class Hand:
    """Pressures of an arm under a hand, without a bus."""

    def __init__(self, arm, seed, noise_pa=200.0):
        self.arm = arm
        self.scene = pressed_scene(arm)
        self.rng = np.random.default_rng(seed)
        self._noise = noise_pa
        self.offset = np.zeros(arm.n_tactels)
        """Pa, zeros that lie elsewhere than the files say."""
        geometry = Geometry.of(arm, discs=True)
        self._law = self.scene.layer.bind(geometry, self.scene.plan.indenters)

    def pressures(self):
        pressures = np.zeros(self.arm.n_tactels)
        self._law.add(self.scene.plan.load(0.0), pressures)
        return pressures + self.offset + self._noise * self.rng.standard_normal(len(pressures))


ASKED = re.compile(r"\[(\d+)/\d+\] .*: press the centre\.$")


class Person:
    """Does what the newest line asks for, on the boards as they are mounted; off by 2 mm or so."""

    def __init__(self, arm, seed, sloppy_mm=2.0):
        self.arm = arm
        self.rng = np.random.default_rng(seed)
        self._sloppy = sloppy_mm

    def aim(self, line):
        """Where a line asks to press: link, s, a."""
        return self.point(int(ASKED.search(line)[1]) - 1)

    def point(self, p, off=(0.0, 0.0)):
        """Where the centre of the board at a place is, or a point off it: link, s, a."""
        placed = self.arm.patches[p]
        x, y = off + 1e-3 * self._sloppy * self.rng.standard_normal(2)
        surface = self.arm.links[placed.link].surface
        s, a = surface.undevelop(placed.s + x, y, placed.a)
        return placed.link, float(s), float(a)
