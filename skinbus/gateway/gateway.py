"""A core on two buses: the frames of a skin on one, its patches as CANopen devices on the other."""

from __future__ import annotations

from collections.abc import Sequence

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import CobIds, Frame, Frames
from skinbus.errors import ArgumentError
from skinbus.gateway.frame_format import CommandTable, FrameFormat
from skinbus.gateway.receiver import Receiver
from skinbus.model import Arm
from skinbus.node import Device
from skinbus.node.host import PatchHost
from skinbus.objects.profile import GUARD_PERIOD_US, index_of, number_at

CANOPEN = 0
SKIN = 1
"""Numbers of the buses."""

START_AGAIN_NS = 1_000_000_000
"""How often the start commands are repeated to boards that do not send: they may have been off."""


class Gateway(Core):
    """The patches of an arm that another skin reads.

    Args:
        found: what the frames of the skin look like.
        arm: the patches; those with an address are the skin's.
        ods: (n_patches,) object dictionaries of all patches of the arm.

    Raises:
        ArgumentError: no patch has an address, one has an address that the format has not, two have the same,
            a board has another number of tactels than the format, readings that are not of 16 bits, or a
            guarded one another period. All faults are listed.
    """

    n_buses = 2

    def __init__(self, found: FrameFormat, arm: Arm, ods: Sequence[ObjectDictionary]) -> None:
        self._format = found
        mine = [k for k, placed in enumerate(arm.patches) if placed.address is not None]
        self.addresses = [str(arm.patches[k].address) for k in mine]
        self._check(arm, ods, mine)
        self.receiver = Receiver(found, self.addresses)
        self.node_ids: list[int] = arm.node_id[mine].tolist()
        devices = [
            Device(ods[k], node_id, storage={}) for k, node_id in zip(mine, self.node_ids, strict=True)
        ]
        self._host = PatchHost(devices, self.receiver.newest)
        self._faults = [""] * len(mine)
        self._start_ns = self._judge_ns = -1

    def cob_ids_on(self, bus: int) -> CobIds | None:
        """Identifiers received on a bus."""
        return self.receiver.can_ids if bus == SKIN else self._host.cob_ids

    def not_sent(self, now_ns: int, frames: Frames) -> None:
        """Have the EMCY messages among these frames sent again."""
        self._host.not_sent(now_ns, [frame for frame in frames if frame.bus == CANOPEN])

    def step(self, now_ns: int, frames: Frames = ()) -> Step:
        """Take the frames received up to ``now_ns``, do what is due, and say when to call again."""
        for frame in frames:
            if frame.bus == SKIN:
                self.receiver.take(frame)
        out: list[Frame] = []
        events: list[Event] = []
        if now_ns >= self._judge_ns:
            self._judge_ns = now_ns + self.receiver.period_ns
            self._judge(now_ns, out, events)
        step = self._host.step(now_ns, [frame for frame in frames if frame.bus == CANOPEN])
        return Step([*step.frames, *out], [*step.events, *events], min(step.wake_ns, self._judge_ns))

    def last_frames(self, now_ns: int) -> list[Frame]:
        """Return the commands that end the skin's sending."""
        return self._commands(now_ns, self._format.stop, self.addresses)

    def _judge(self, now_ns: int, out: list[Frame], events: list[Event]) -> None:
        """Poll, start boards that do not send, and report what has changed."""
        self.receiver.newest(now_ns)
        faults = self.receiver.faults
        columns = (self.node_ids, self.addresses, self._faults, faults)
        for node_id, address, before, fault in zip(*columns, strict=True):
            if fault != before and self._host.is_on:  # boards need a while to start
                kind = EventKind.READINGS_LOST if fault else EventKind.PATCH_BACK
                detail = f"{address or 'the board'}: {fault or 'its readings are good again'}"
                events.append(Event(now_ns, kind, node_id=node_id, detail=detail))
        if self._host.is_on:
            self._faults = faults
        if now_ns >= self._start_ns:
            self._start_ns = now_ns + START_AGAIN_NS
            silent, running = (
                self._commands(
                    now_ns,
                    self._format.start,
                    [a for a, fault in zip(self.addresses, faults, strict=True) if bool(fault) is is_silent],
                )
                for is_silent in (True, False)
            )
            # not to a board that sends: one triangle that is not connected must not restart its others
            out += [frame for frame in silent if frame not in running]
        out += self._commands(now_ns, self._format.poll, self.addresses)

    def _commands(self, now_ns: int, tables: Sequence[CommandTable], addresses: Sequence[str]) -> list[Frame]:
        every = self._format.commands(tables, addresses)
        return [Frame(can_id, data, now_ns, bus=SKIN) for can_id, data in every]

    def _check(self, arm: Arm, ods: Sequence[ObjectDictionary], mine: Sequence[int]) -> None:
        faults = [] if mine else [f"no [[patch]] of {arm.name} has an address"]
        seen: dict[str, int] = {}
        for k, address in zip(mine, self.addresses, strict=True):
            placed = arm.patches[k]
            try:
                self._format.numbers(address)
            except ArgumentError as error:
                faults.append(f"node {placed.node_id}: {error}")
            for unit, is_so, wanted in (
                ("tactels", placed.patch.n_tactels, self._format.n_tactels),
                ("bits", placed.patch.transducer.bits, 16),  # of counts: in fewer they would wrap
            ):
                if is_so != wanted:
                    faults.append(f"node {placed.node_id}: {is_so} {unit}; wanted {wanted}")
            period_us = round(1000 * self._format.period_ms)
            if (
                arm.guarded[k]
                and (said := number_at(ods[k], *index_of(ods[k], GUARD_PERIOD_US))) != period_us
            ):
                faults.append(
                    f"node {placed.node_id}: samples every {period_us} us; [2080sub4] of its EDS says {said}"
                )
            if (other := seen.setdefault(address, placed.node_id)) != placed.node_id:
                faults.append(f"node {placed.node_id}: address {address!r} is that of node {other}")
        if faults:
            raise ArgumentError("; ".join(faults))
