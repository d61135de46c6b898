"""A board on a bus of this process, and a hand that presses it."""

import threading
from contextlib import contextmanager

from skinbus.config.system import load_arm
from skinbus.sim import World
from tests.master.commissioning.person import FORCE_N, Person, mounted, pressed_scene

SEED = 20261123


@contextmanager
def pressed_pad(bus):
    """A board on a bus of this process, pressed in its middle."""
    arm = mounted(load_arm("pad"), SEED)
    scene = pressed_scene(arm)
    over = threading.Event()
    person = Person(arm, SEED)

    def press():
        while not over.wait(0.35):
            scene.plan.touches = [(*person.point(0), FORCE_N)]
            over.wait(0.9)
            scene.plan.touches = []

    hand = threading.Thread(target=press)
    with bus.with_cores(World(scene)):
        try:
            yield arm, hand
        finally:
            over.set()
            if hand.ident:
                hand.join()
