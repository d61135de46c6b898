"""Small cores to put on a bus, which say what they are told to, and a bit error."""

from skinbus.can.arbitration import collide
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.wire_bits import frame_bits

ERROR_BITS = 20
"""The error flags of all nodes (12) and the delimiter (8); intermission is part of the destroyed frame."""


def bare(frames):
    """Frames without their times."""
    return [(frame.can_id, frame.data, frame.flags) for frame in frames]


def destroy_one(wire, can_id):
    """Let a bit error in its last bit destroy the next frame with an identifier; its sender repeats it."""

    def collide_once(frames, error_counters):
        if frames[0].can_id != can_id:
            return collide(frames, error_counters)
        wire.collide = collide
        return [], [*range(len(frames))], frame_bits(frames[0]) + ERROR_BITS

    wire.collide = collide_once


class Talker(Core):
    """Sends given frames at given times, and others in answer to what it hears; keeps what it hears."""

    cob_ids = frozenset()

    def __init__(self, plan=(), cob_ids=None, answers=()):
        self.plan = sorted(plan, key=lambda item: item[0])
        self.cob_ids, self.answers = cob_ids, answers
        self.heard = []
        self.steps = []

    def step(self, now_ns, frames):
        self.steps.append(now_ns)
        self.heard += frames
        due = [frame for t_ns, frame in self.plan if t_ns <= now_ns]
        self.plan = self.plan[len(due) :]
        due += self.answers if frames else ()
        return Step(due, (), self.plan[0][0] if self.plan else NEVER)


class Repeater(Core):
    """Sends the same frame again and again."""

    cob_ids = frozenset()

    def __init__(self, frame, every_ns, begin_ns=0, end_ns=NEVER):
        self.frame, self.every_ns, self.next_ns, self.end_ns = frame, every_ns, begin_ns, end_ns

    def step(self, now_ns, frames):
        out = []
        if now_ns >= self.next_ns:
            out.append(self.frame)
            self.next_ns = now_ns + self.every_ns
        return Step(out, (), self.next_ns if self.next_ns < self.end_ns else NEVER)
