"""The skin of an arm as programs use it: cycles in order, the newest one, events; from whatever source."""

from __future__ import annotations

import asyncio
import logging
import math
import time
import weakref
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Literal, Self, get_args

import numpy as np

from skinbus.arrays import Floats
from skinbus.errors import ArgumentError
from skinbus.estimate import TrackState
from skinbus.formatting import counted
from skinbus.skin.cycle import Contact, Cycle, Patch, PatchState
from skinbus.skin.feed import Feed, Positions

POLL_S = 0.2
"""How often one who waits for a cycle looks whether the skin was closed."""

LOG = logging.getLogger("skinbus")

Handler = Callable[[Contact], object]
Kind = Literal["touch", "move", "lift", "lost"]
KINDS: tuple[Kind, ...] = get_args(Kind)

UNSEEN_S = 0.5
"""A contact that is not seen for so long has no readings, s: half of the time after which it ends for that;
one that readings do not show ends within a cycle or two, unless another contact hides it; ..."""
UNSEEN_PERIODS = 2.5
"""... at low rates so many periods: half a period more than a cycle or two."""
STALE_PERIODS = 1.5
"""Readings older than so many periods at the SYNC of a cycle are not of the cycle before it."""


class Skin:
    """The contacts, readings and patches of an arm; made by ``skinbus.open`` and its like.

    ::

        for cycle in skin            every cycle once, in order
        async for cycle in skin      the same beside other tasks
        skin.latest()                the newest cycle, at once
        skin.get(0.1)                the next cycle, if it comes within so long
        skin.on("touch", f)          f(contact), once for each event
        skin.joints = q              joint positions now, for an arm with a robot

    What a consumer is too slow for is lost, counted in ``n_lost`` and logged as a warning. Leaving the
    ``with`` block ends the source: a master takes its contacts back and stops the patches.
    """

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._next = feed.first
        self._handlers: dict[Kind, list[Handler]] = {kind: [] for kind in KINDS}
        self._events = TouchEvents()
        self._dispatched = 0
        self.n_lost = 0
        """Cycles that the iteration came too late for."""
        # Patches are stopped too when a program ends without closing its skin.
        self._finalizer = weakref.finalize(self, feed.close)

    def __repr__(self) -> str:
        layout, state = self._feed.layout, "" if self.is_running else ", ended"
        patches = counted(len(layout.node_id), "patch")
        number = self._feed.peek().number
        return f"<Skin {layout.name!r}: {patches}, {self._feed.what}, cycle {number}{state}>"

    @property
    def name(self) -> str:
        """Name of the arm."""
        return self._feed.layout.name

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links."""
        return self._feed.layout.links

    @property
    def period_s(self) -> float:
        """Time between two cycles, s."""
        return 1e-9 * self._feed.layout.period_ns

    @property
    def patches(self) -> tuple[Patch, ...]:
        """The patches as they were in the newest cycle.

        They are bus after bus as in the arm file; on each single patches, then those of rings.
        """
        return self._feed.peek().patches

    def patch_at(self, node_id: int, bus: str | None = None) -> int:
        """Return the index in ``patches`` of the patch with a node-ID; ``bus`` where node-IDs repeat.

        Raises:
            ArgumentError: there is none, or there are several.
        """
        return self._feed.layout.patch_at(node_id, bus)

    @property
    def is_running(self) -> bool:
        """Whether the source has not ended: for shared memory, whether the process that writes is there.

        One that hangs, and a bus that carries nothing, show in ``latest().age_s``.
        """
        return self._finalizer.alive and self._feed.is_running

    @property
    def pace(self) -> float:
        """Seconds of a simulation or a recording in one of real time: below 1 the machine is too slow."""
        return self._feed.pace

    def latest(self) -> Cycle:
        """Return the newest cycle; never waits for one. Before the first one its number is 0.

        A replay or a simulation without ``realtime`` has no time of its own: there it is the next cycle.
        """
        cycle = self._feed.newest()
        if self._feed.is_pulled:
            self._next = max(self._next, cycle.number + 1)
        self._dispatch(cycle)
        return cycle

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that move skin or tool, in the order of positions and torques; none without a robot."""
        return self._feed.layout.joints or ()

    @property
    def joints(self) -> Floats:
        """Joint positions (rad; m of prismatic joints) at the SYNC of the newest cycle, NaN where not known.

        Set them as they are now: a number for each joint that is not fixed, in the order
        of ``joint_names``, or some by name. Raises ArgumentError for others, and LocalProtocolError where the
        source takes none: only the process of the master does.
        """
        return self._feed.peek().joint_positions

    @joints.setter
    def joints(self, positions: Positions) -> None:
        self.set_joints(positions)

    def set_joints(self, positions: Positions, t_ns: int | None = None) -> None:
        """Set joint positions as they were at a time on the clock of the source, that of ``cycle.t_ns``.

        Raises:
            ArgumentError: a number of them, a name or a value that cannot be; nothing is taken then.
            LocalProtocolError: this source takes none.
        """
        self._feed.set_joints(self._feed.now_ns() if t_ns is None else t_ns, positions)

    def zero(self, patch: int | None = None) -> None:
        """Make what the tactels read now their zero: nothing may touch them.

        patch: index of a patch in ``patches``; None for all

        Raises:
            ArgumentError: there is no such patch.
            BusError: no cycle came, or no master answered.
            LocalProtocolError: this source cannot: a recording, and shared memory.
        """
        n = len(self._feed.layout.node_id)
        if patch is not None and not (isinstance(patch, int | np.integer) and 0 <= patch < n):
            raise ArgumentError(
                f"no patch {patch!r}; wanted an index in patches, 0..{n - 1}, or None for all"
            )
        self._feed.zero(None if patch is None else int(patch))

    def on(self, kind: Kind, handler: Handler) -> None:
        """Call ``handler(contact)`` once for each event: "touch", "move" (it begins to), "lift" or "lost".

        A contact is lost, not lifted, when it has ended without readings that could have shown it, as those
        of a board that stopped answering: whether what pressed is still there is not known.

        Handlers are called by who takes the cycles, with ``for``, ``latest`` or ``wait``, and what one raises
        is raised there.
        """
        if kind not in KINDS:
            raise ArgumentError(f"no event is called {kind!r}; there are {', '.join(KINDS)}")
        self._handlers[kind].append(handler)

    def wait(self, seconds: float = math.inf) -> None:
        """Take cycles, for their handlers, until the source ends or for so long; raises what has ended it."""
        end = time.monotonic() + seconds
        while not self._has_ended() and (left_s := end - time.monotonic()) > 0.0:
            self.get(min(POLL_S, left_s))

    def get(self, seconds: float) -> Cycle | None:
        """Return the next cycle, or None if none comes within so long; raises what has ended the source."""
        cycle = None if self._has_ended() else self._feed.get(self._next, seconds)
        return self._take(cycle) if cycle else None

    def close(self) -> None:
        """End the source; a second call does nothing."""
        self._finalizer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Cycle]:
        return self

    def __next__(self) -> Cycle:
        """Return the next cycle, waiting for it; the end of the source ends the iteration.

        Raises what has ended the source, if that is an error.
        """
        while not self._has_ended():
            if cycle := self.get(POLL_S):
                return cycle
        raise StopIteration

    def __aiter__(self) -> AsyncIterator[Cycle]:
        return self

    async def __anext__(self) -> Cycle:
        """Return the next cycle, while other tasks go on."""
        while not self._has_ended():
            # Only what was handed over is counted as taken: a task may be cancelled meanwhile.
            if cycle := await asyncio.to_thread(self._feed.get, self._next, POLL_S):
                return self._take(cycle)
        raise StopAsyncIteration

    def _has_ended(self) -> bool:
        """Whether no more cycles will come; raises what has ended the source."""
        is_over = self._feed.is_over or not self._finalizer.alive
        return is_over and self._feed.get(self._next, 0.0) is None

    def _take(self, cycle: Cycle) -> Cycle:
        """Note that a cycle is handed over."""
        if (n := cycle.number - self._next) > 0:
            self.n_lost += n
            LOG.warning("%d cycles lost: they came faster than they were taken", n)
        self._next = cycle.number + 1
        self._dispatch(cycle)
        return cycle

    def _dispatch(self, cycle: Cycle) -> None:
        """Call the handlers of the events of a cycle, once."""
        if cycle.number <= self._dispatched or not any(self._handlers.values()):
            return
        self._dispatched = cycle.number
        for kind, contact in self._events.step(cycle):
            for handler in self._handlers[kind]:
                handler(contact)


class TouchEvents:
    """Finds the events of cycles that follow each other, also where some between them were lost.

    ::

        touch  an id that was not there in the cycle before
        move   state MOVE, and the state before was another
        lift   an id is not there any more, or has state LIFT, or is that of another contact now
        lost   as lift, but it has ended because readings of its link are missing: nothing shows a release
    """

    def __init__(self) -> None:
        self._there: dict[int, Contact] = {}

    def step(self, cycle: Cycle) -> list[tuple[Kind, Contact]]:
        """Return the events of a cycle; a contact that has gone is as it was last, with state LIFT."""
        events: list[tuple[Kind, Contact]] = []
        there = {contact.id: contact for contact in cycle.contacts if contact.state is not TrackState.LIFT}
        for key, before in self._there.items():
            if not _is_same(before, there.get(key)):
                is_lost = key not in there and _is_lost(before, cycle)
                events.append(("lost" if is_lost else "lift", before.lifted()))
        for key, contact in there.items():
            known = self._there.get(key)
            if known is None or not _is_same(known, contact):
                events.append(("touch", contact))
                known = None
            if contact.state is TrackState.MOVE and (known is None or known.state is not TrackState.MOVE):
                events.append(("move", contact))
        self._there = there
        return events


def _is_lost(contact: Contact, cycle: Cycle) -> bool:
    """Whether a contact that has ended in a cycle had no readings that could have shown it."""
    period_ns = cycle.layout.period_ns
    unseen_ns = cycle.t_ns - contact.seen_ns
    if contact.state is not TrackState.COAST or unseen_ns < max(1e9 * UNSEEN_S, UNSEEN_PERIODS * period_ns):
        return False
    return any(
        patch.state is not PatchState.OPERATIONAL
        or cycle.t_ns - patch.last_fresh_ns > STALE_PERIODS * period_ns
        for patch in cycle.patches
        if patch.link == contact.link
    )


def _is_same(before: Contact, now: Contact | None) -> bool:
    """Whether two contacts with one id are one; where identities are not known, a new one has state TOUCH."""
    if now is None:
        return False
    if before.identity or now.identity:
        return before.identity == now.identity
    return now.state is not TrackState.TOUCH or before.state is TrackState.TOUCH
