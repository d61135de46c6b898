"""The skin of an arm as programs use it: cycles in order, the newest one, events; from whatever source."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
import weakref
from collections.abc import AsyncIterator, Callable, Iterator
from types import TracebackType
from typing import Final, Self

import numpy as np

from skinbus.errors import ArgumentError, ShareError
from skinbus.skin.cycle import Contact, Cycle, Floats, Patch
from skinbus.skin.feed import Feed, Positions
from skinbus.skin.touch_events import KINDS, Kind, TouchEvents

POLL_S: Final = 0.2
"""How often one who waits for a cycle looks whether the skin was closed."""

LOG = logging.getLogger("skinbus")

Handler = Callable[[Contact], object]


class Skin:
    """The contacts, readings and patches of an arm; made by ``skinbus.open`` and its like.

    ::

        for cycle in skin            every cycle once, in order
        async for cycle in skin      the same beside other tasks
        skin.latest()                the newest cycle, at once
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
        self._dispatcher: threading.Thread | None = None
        self._is_closed = threading.Event()
        self._failed: BaseException | None = None
        self._n_lost = 0
        self._n_events_lost = 0
        # Patches are stopped too when a program ends without closing its skin.
        self._finalizer = weakref.finalize(self, feed.close)

    @property
    def n_lost(self) -> int:
        """Cycles that the iteration, and the handlers of events, came too late for."""
        return self._n_lost + self._n_events_lost

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
        return not self._is_closed.is_set() and self._feed.is_running

    def latest(self) -> Cycle:
        """Return the newest cycle; never waits for one. Before the first one its number is 0.

        A replay or a simulation without ``realtime`` has no time of its own: there it is the next cycle.
        """
        if self._failed is not None:
            self._raise_failure()
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

        Set them as they are now: a number for each joint that is neither fixed nor of a drive, in the order
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
        self._feed.set_joints(positions, t_ns)

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

        Handlers are called one after the other: of a live source by a thread of the skin, of a replay or a
        simulation without ``realtime`` by whoever takes the cycles. What one raises is raised by the next
        use of the skin.
        """
        if kind not in KINDS:
            raise ArgumentError(f"no event is called {kind!r}; there are {', '.join(KINDS)}")
        self._handlers[kind].append(handler)
        if not self._feed.is_pulled and self._dispatcher is None:
            self._dispatcher = threading.Thread(target=self._run_handlers, name="skinbus-events", daemon=True)
            self._dispatcher.start()

    def wait(self, seconds: float | None = None) -> None:
        """Wait until the source ends, or for so long, while handlers are called.

        Raises what has ended the source, and what a handler raised.
        """
        end = time.monotonic() + seconds if seconds is not None else float("inf")
        while not self._feed.is_over and not self._is_closed.is_set() and time.monotonic() < end:
            self._raise_failure()
            if self._feed.is_pulled:
                self.latest()
            else:
                self._feed.newest()
                self._is_closed.wait(min(POLL_S, max(end - time.monotonic(), 0.0)))
        self._raise_failure()

    def close(self) -> None:
        """End the source; a second call does nothing.

        Raises what a handler raised.
        """
        self._is_closed.set()
        self._finalizer()
        if self._dispatcher is not None and self._dispatcher is not threading.current_thread():
            self._dispatcher.join()
        self._raise_failure()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except BaseException as failure:
            if error is None or failure is error:
                raise
            error.add_note(f"then: {failure!r}")

    def __iter__(self) -> Iterator[Cycle]:
        return self

    def __next__(self) -> Cycle:
        """Return the next cycle, waiting for it; the end of the source ends the iteration.

        Raises what has ended the source, if that is an error.
        """
        while True:
            self._raise_failure()
            cycle = self._feed.get(self._next, POLL_S)
            if cycle is not None:
                return self._take(cycle)
            if self._feed.is_over or self._is_closed.is_set():
                raise StopIteration

    def __aiter__(self) -> AsyncIterator[Cycle]:
        return self

    async def __anext__(self) -> Cycle:
        """Return the next cycle, while other tasks go on."""
        while True:
            self._raise_failure()
            # Only what was handed over is counted as taken: a task may be cancelled meanwhile.
            cycle = await asyncio.to_thread(self._feed.get, self._next, POLL_S)
            if cycle is not None:
                return self._take(cycle)
            if self._feed.is_over or self._is_closed.is_set():
                raise StopAsyncIteration

    def _take(self, cycle: Cycle) -> Cycle:
        """Note that a cycle is handed over."""
        lost = cycle.number - self._next
        if lost > 0:
            self._n_lost += lost
            LOG.warning("%d cycles lost: they came faster than they were taken", lost)
        self._next = cycle.number + 1
        if self._feed.is_pulled:
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

    def _run_handlers(self) -> None:
        """Follow the cycles and call handlers until the skin is closed; in a thread."""
        number = max(self._feed.first, self._next)
        try:
            while not (self._is_closed.is_set() or self._feed.is_over):
                cycle = self._feed.get(number, POLL_S)
                if cycle is None:
                    continue
                lost = cycle.number - number
                if lost > 0:
                    self._n_events_lost += lost
                    LOG.warning("%d cycles lost: handlers of events were too slow", lost)
                number = cycle.number + 1
                self._dispatch(cycle)
        except ShareError:
            pass  # the process that writes has died: ``is_running`` says so, and ``latest()`` goes on
        except BaseException as error:  # noqa: BLE001 - raised where the skin is used
            self._failed = error

    def _raise_failure(self) -> None:
        failed, self._failed = self._failed, None
        if failed is not None:
            raise failed
