"""Patches that send on a change instead of with SYNC, on the simulated wire: latency, load and error.

Every patch samples by its own clock, all at one rate, and sends a TPDO when one of its readings has moved by
more than the touch threshold since it was sent (CiA 401 delta, transmission type 255). Who listens cannot
detect when a sample is complete: it waits until no reading has come for ``GAP_NS``, estimates from the newest
reading of every tactel, and publishes. A reading may be off by the threshold for as long as it does not
move: that is what silence costs in accuracy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame, FrameBatch
from skinbus.config.system import ods_of
from skinbus.estimate import Contacts, Estimator
from skinbus.master.gather import Gather
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.objects.contacts import ContactState, pack_contacts
from skinbus.objects.pdo import tpdos
from skinbus.objects.published import usual
from skinbus.objects.readings import ReadingsPlan
from skinbus.sim import World

GAP_NS: Final = 300_000
"""Two frames at 1 Mbit/s: the frames of one burst follow each other without a gap."""


def send_on_change(world: World, arm: Arm) -> None:
    """Set the patches of a world, before they are switched on, to send what moves by the touch threshold."""
    for device, placed, od in zip(world.devices, arm.patches, ods_of(arm), strict=True):
        patch = placed.patch
        for pdo in tpdos(od):
            device.set(
                cia.TPDO_COMMUNICATION + pdo.number - 1, cia.PDO_TYPE, cia.TransmissionType.EVENT_PROFILE
            )
        for number in range(1, patch.n_tactels + 1):
            device.set(cia.ANALOGUE_TRIGGER, number, cia.Trigger.DELTA)
            device.set(cia.ANALOGUE_DELTA, number, int(patch.threshold / patch.transducer.step))
        device.set(cia.ANALOGUE_INTERRUPT_ENABLE, 0, True)


class OnChange(Core):
    """A core that starts the patches, listens, estimates when a burst is over, and publishes contacts."""

    cob_ids: frozenset[int] | None = frozenset()

    def __init__(self, arm: Arm, level: str, *, start_ns: int) -> None:
        ods = ods_of(arm)
        self._plan = ReadingsPlan(arm, ods)
        self._gather = Gather(self._plan, arm.n_tactels)
        self._estimator = Estimator(arm, level)
        self._scale = self._plan.counts_scale * arm.tactel_gain
        self._none = np.zeros(arm.n_patches, np.bool_)
        self.cob_ids = self._plan.cob_ids
        self.answers: list[tuple[int, Contacts]] = []
        """Time of the first reading of each burst, and what was made of it."""
        self._start_ns, self._first_ns, self._due_ns = start_ns, NEVER, NEVER
        self._gather.open(0, self._none)

    def data_ids_on(self, bus: int) -> frozenset[int]:
        """Identifiers that carry readings."""
        return self._plan.cob_ids_on[bus]

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Take readings; the estimate waits until no more have come for a while."""
        self._gather.take(batch)
        self._first_ns = min(self._first_ns, int(batch.t_ns[0]))
        self._due_ns = now_ns + GAP_NS

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Start the patches when it is time; publish when a burst is over."""
        out: list[Frame] = []
        if now_ns >= self._start_ns:
            self._start_ns = NEVER
            out.append(Frame(cia.NMT_COMMAND_ID, bytes([cia.NmtCommand.START, 0])))
        if now_ns >= self._due_ns:
            out += self._answer()
        return Step(out, (), min(self._start_ns, self._due_ns))

    def _answer(self) -> list[Frame]:
        self._gather.close()
        self._gather.open(0, self._none)
        pressures = (self._gather.counts - self._plan.counts_offset) * self._scale
        contacts = self._estimator.update(pressures, self._first_ns)
        self.answers.append((self._first_ns, contacts))
        self._first_ns = self._due_ns = NEVER
        objects = usual()
        n = min(len(contacts), len(objects.contacts))
        payload = pack_contacts(
            id=np.arange(1, n + 1),
            link=contacts.link[:n],
            state=np.full(n, ContactState.HELD),
            s=contacts.s[:n],
            a=contacts.a[:n],
            force=contacts.force[:n],
        )
        out = [Frame(objects.summary.cob_id, bytes(8))]
        rows = zip(objects.contact_ids[:n], payload, strict=True)
        return out + [Frame(cob_id, row.tobytes()) for cob_id, row in rows]
