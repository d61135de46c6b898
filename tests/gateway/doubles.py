"""Boards of skins that are not CANopen: they send the readings of a scene by their own clock."""

import numpy as np

from skinbus.can.core import Core, Step
from skinbus.can.frame import Frame
from skinbus.model.patch import grid
from skinbus.objects.new_board import NewBoard
from skinbus.sim import load_scene
from skinbus.sim.sampler import Sampler
from tests.files import put


def frame_of(part, raw, kind):
    """Return identifier and data of the frame of a part, as a board with readings (n_tactels,) sends it."""
    data = bytearray(part.length)
    data[: len(part.data)] = part.data
    sent = np.where(part.to >= 0, np.array(raw)[part.to], 0xAA).astype(kind).tobytes()
    data[part.table.byte : part.table.byte + len(sent)] = sent
    return part.can_id, bytes(data)


class Double(Core):
    """All boards of a skin; each sends its readings every period, from its start on.

    ``changes`` of an address take its frames and return what it sends instead. ``twice`` are addresses that
    two boards have; one sends half a period after the other.
    """

    cob_ids = None

    def __init__(self, found, arm, scene):
        self.found, self.scene = found, scene
        self.sampler = Sampler(scene)
        placed = [(p, patch) for p, patch in enumerate(arm.patches) if patch.address is not None]
        self.tactels = {patch.address: arm.tactels_of(p) for p, patch in placed}
        self.parts = {address: found.parts(address) for address in self.tactels}
        self.period_ns = round(1e6 * found.period_ms)
        self.due_ns = {address: (7 * k % 11) * self.period_ns // 11 for k, address in enumerate(self.tactels)}
        self.starts = {address: found.commands(found.start, [address])[-1:] for address in self.tactels}
        self.running = {address for address, wanted in self.starts.items() if not wanted}
        self.heard = []
        self.twice, self.changes = set(), {}

    def step(self, now_ns, frames):
        for frame in frames:
            self.heard.append((frame.can_id, frame.data))
            said = (frame.can_id, frame.data)
            self.running |= {address for address, wanted in self.starts.items() if said in wanted}
        out = []
        for address, due_ns in self.due_ns.items():
            if due_ns > now_ns:
                continue
            every_ns = self.period_ns // (2 if address in self.twice else 1)
            self.due_ns[address] += (1 + (now_ns - due_ns) // every_ns) * every_ns  # nothing is made up for
            if address in self.running:
                out += self.frames_of(address, now_ns)
        return Step(out, (), min(self.due_ns.values()))

    def frames_of(self, address, now_ns):
        self.sampler.sample(1e-9 * now_ns % self.scene.duration_s)
        counts = self.sampler.counts[self.tactels[address]]
        found = self.found
        kind = np.iinfo(found.type)
        raw = np.clip(np.rint(found.zero + counts / found.gain), kind.min, kind.max)
        sent = [Frame(*frame_of(part, raw, found.type), now_ns) for part in self.parts[address]]
        return self.changes[address](sent) if address in self.changes else sent


def write_scene(folder, addresses, columns, rows, *, bits=9, touches=""):
    """Write an arm, a board for each address side by side on a plate, and a scene on it; load the scene."""
    pitch_mm = 6.5
    uv = 1e-3 * grid(columns, rows, pitch_mm)
    board = NewBoard(name="board.eds", tactels_uv=uv, pitch=1e-3 * pitch_mm, bits=bits)
    put(folder, "board.eds", board.text())
    width_mm = columns * pitch_mm + 1.5
    text = f"""[arm]
name = "plate"
rate_hz = 50.0
[[link]]
name = "plate"
surface = "plane"
length_mm = {len(addresses) * width_mm + 1.0}
width_mm = {rows * pitch_mm + 2.0}
"""
    for k, address in enumerate(addresses):
        text += f"""[[patch]]
node_id = {k + 1}
link = "plate"
s_mm = {(k + 0.5) * width_mm}
eds = "board.eds"
address = "{address}"
"""
    put(folder, "plate.toml", text)
    return load_scene(
        put(folder, "scene.toml", f'[scene]\narm = "plate.toml"\nduration_s = 1000.0\n{touches}')
    )
