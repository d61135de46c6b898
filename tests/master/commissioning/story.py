"""A dialogue that identifies boards, a hand, and an arm as it is mounted; no bus."""

from functools import cache

import numpy as np

from skinbus.config.arm_file import find_arm, read_arm_file
from skinbus.config.system import load_arm
from skinbus.master.commissioning.identification import Board, Identification
from skinbus.master.commissioning.unplaced_boards import kinds_of, places_of
from tests.master.commissioning.person import FORCE_N, Hand, Person, mounted

CYCLE_NS = 50_000_000
SEED = 20261122


@cache
def prepared(name):
    """What all stories of an arm have in common; reading its boards takes a while."""
    plan, mountings = load_arm(name), read_arm_file(find_arm(name)).mountings
    return plan, mountings, places_of(plan), kinds_of(plan)


class Story:
    """A dialogue, a hand, and an arm as it is mounted."""

    def __init__(self, name="forearm", seed=SEED):
        self.plan, self.mountings, places, kinds = prepared(name)
        self.arm = mounted(self.plan, seed)
        self.hand, self.person = Hand(self.arm, seed + 1), Person(self.arm, seed + 2)
        self.order = np.argsort(self.arm.node_id)
        """Boards by node-ID, as a scan finds them."""
        boards = [
            Board(
                int(self.arm.node_id[p]),
                kinds[p].kind,
                self.plan.patches[p].patch.tactels_uv,
                self.plan.patches[p].patch.threshold,
                self.arm.patches[p].serial,
            )
            for p in self.order
        ]
        self.dialogue = Identification(places, boards)
        self.now_ns, self.lines = 0, []
        self.wait(0.5)

    def wait(self, seconds, *answers):
        lines = []
        for _ in range(round(1e9 * seconds / CYCLE_NS)):
            self.now_ns += CYCLE_NS
            pressures = self.hand.pressures()
            own = [pressures[self.arm.tactels_of(p)] for p in self.order]
            lines += self.dialogue.step(self.now_ns, np.concatenate(own), answers)
            answers = ()
        self.lines = lines or self.lines
        return lines

    def press(self, *points, force=FORCE_N, seconds=0.6):
        """Press points (link, s, a) together."""
        self.hand.scene.plan.touches = [(*point, force) for point in points]
        lines = self.wait(seconds)
        self.hand.scene.plan.touches = []
        return lines + self.wait(0.3)

    def obey(self):
        """Do what the newest line asks for."""
        return self.press(self.person.aim(self.lines[-1]))

    def one_place(self):
        n = len(self.dialogue.found)
        while len(self.dialogue.found) == n:
            self.obey()

    def check(self):
        """All that was found is so."""
        for mounting, placed in zip(self.mountings, self.arm.patches, strict=True):
            own = self.dialogue.found.get(mounting.key)
            if own is None:
                continue
            assert own.node_id == placed.node_id
            assert own.serial == placed.serial
