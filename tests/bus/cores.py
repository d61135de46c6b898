"""Small cores to put on a bus: one that says what it is told to, one that listens."""

from skinbus.can.core import NEVER, Core, Step


class Talker(Core):
    """Sends given frames at given times; keeps what it hears."""

    cob_ids = frozenset()

    def __init__(self, plan=(), cob_ids=None):
        self.plan = sorted(plan, key=lambda item: item[0])
        self.cob_ids = cob_ids
        self.heard = []
        self.steps = []

    def step(self, now_ns, frames):
        self.steps.append(now_ns)
        self.heard += frames
        due = [frame for t_ns, frame in self.plan if t_ns <= now_ns]
        self.plan = self.plan[len(due) :]
        return Step(due, (), self.plan[0][0] if self.plan else NEVER)
