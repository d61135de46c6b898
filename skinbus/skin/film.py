"""A recording gone through once and kept, so that any of its cycles is there at once: to be looked at.

Cycles are kept in a file without a name, as shared memory has them: a long recording takes no more room in
memory than a table of its cycles. Beside each stand the contacts that the master of the recording published.
"""

from __future__ import annotations

import bisect
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skinbus.can.frame import Frame
from skinbus.config.system import load_arm
from skinbus.errors import LocalProtocolError
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.model import Arm
from skinbus.objects.contacts import ContactState
from skinbus.objects.profile import MASTER_NODE_ID
from skinbus.skin.attached import SharedCycle
from skinbus.skin.bus_meter import BusMeter
from skinbus.skin.cycle import CONTACT, UNKNOWN_LEVEL, Cycle, Records, fill_places
from skinbus.skin.listener import ContactRow, Listener
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.recording import Recording
from skinbus.skin.replayed import Played
from skinbus.skin.shared_memory import Offsets, pack_cycle


class Film:
    """The cycles of a recording by number, from 0; a thread makes them, as fast as the machine can."""

    def __init__(
        self,
        log: str | Path,
        arm: str | Path | Arm,
        *,
        channels: Sequence[str] = (),
        level: str = DEFAULT_LEVEL,
        zero: bool = False,
        node_id: int = MASTER_NODE_ID,
    ) -> None:
        """Begin; as :func:`skinbus.replay`, with channels as the command line has them.

        node_id: of the master in the recording

        Raises:
            ConfigError: arm or log have faults.
            AddressError: which interface of the log is meant is not clear.
        """
        loaded = arm if isinstance(arm, Arm) else load_arm(arm, check_load=False)
        self._recording = Recording(log, loaded, channels)
        self.arm = self._recording.arm
        self.error: Exception | None = None
        """What has ended the making, if that was an error."""
        maker = CycleMaker(self.arm)
        self._layout = maker.layout
        self._offsets = Offsets(self.arm.n_patches, self.arm.n_tactels)
        self._published = _Published(self.arm, node_id)
        self._meter = BusMeter(self.arm.buses)
        self._loads: list[tuple[float, ...]] = []
        self._played = Played(self._recording, maker, level, zero, on_frame=self._take)
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the film
        self._lock = threading.Lock()
        self._ends = [0]
        self._times: list[int] = []
        self._contacts: dict[int, bytes] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._make, name="skinbus-film", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        """How many cycles there are so far."""
        return len(self._times)

    def __getitem__(self, number: int) -> Cycle:
        """Return a cycle; its own number counts from 1."""
        if not 0 <= number < len(self):
            raise IndexError(number)
        with self._lock:
            self._file.seek(self._ends[number])
            data = self._file.read(self._ends[number + 1] - self._ends[number])
        cycle = SharedCycle(data, self._layout, self._offsets, None)
        published = np.frombuffer(self._contacts.get(number, b""), CONTACT)
        cycle.published = published if number in self._contacts else None
        cycle.bus_loads = self._loads[number]
        return cycle

    @property
    def is_complete(self) -> bool:
        """Whether all cycles are there."""
        return not self._thread.is_alive()

    @property
    def begin_ns(self) -> int:
        """Time of the first cycle; 0 when there is none."""
        return self._times[0] if self._times else 0

    @property
    def seconds(self) -> float:
        """Time from the first cycle to the last, s."""
        return 1e-9 * (self._times[-1] - self._times[0]) if self._times else 0.0

    @property
    def marks(self) -> list[tuple[int, float]]:
        """Marks so far: number, and seconds after the first cycle."""
        shift = self._published.shift_ns - self.begin_ns
        return [(number, 1e-9 * (t_ns + shift)) for number, t_ns in list(self._recording.reader.marks)]

    def at(self, seconds: float) -> int:
        """Return the number of the last cycle at so many seconds after the first."""
        times = self._times
        t_ns = self.begin_ns + round(1e9 * seconds)
        return max(bisect.bisect_right(times, t_ns) - 1, 0)

    def seconds_of(self, number: int) -> float:
        """Return when a cycle was, s after the first."""
        return 1e-9 * (self._times[number] - self._times[0])

    def zero(self, patch: int | None) -> None:
        """Refuse: what was recorded has the zeros it has."""
        raise LocalProtocolError("a recording has the zeros it has; --zero takes those of its begin")

    def close(self) -> None:
        """Stop, and discard the cycles."""
        self._stop.set()
        self._thread.join()
        self._file.close()

    def _take(self, frame: Frame, now_ns: int) -> None:
        """Take a frame of the recording; its time on the cycles' clock is ``now_ns``."""
        self._meter.take(frame, now_ns)
        self._published.take(frame, now_ns)

    def _make(self) -> None:
        try:
            while not self._stop.is_set() and (cycle := self._played.next_cycle()) is not None:
                data = pack_cycle(cycle, cycle.number, self._offsets)
                with self._lock:
                    self._file.seek(self._ends[-1])
                    self._file.write(data)
                self._ends.append(self._ends[-1] + len(data))
                if self._times:  # what was published of the cycle before is out when this one has ended
                    self._keep(len(self._times) - 1, cycle.t_ns)
                self._loads.append(self._meter.loads(cycle.ended_ns))
                self._times.append(cycle.t_ns)
            self._keep(len(self._times) - 1, 1 << 62)
        except Exception as error:  # noqa: BLE001 - shown where the film is
            self.error = error

    def _keep(self, number: int, until_ns: int) -> None:
        """Keep what was published from a cycle's SYNC until the next."""
        if self._times and (records := self._published.pop(self._times[number], until_ns)) is not None:
            self._contacts[number] = records.tobytes()


class _Published:
    """What the master of a recording published, by the summary that begins each cycle of it."""

    def __init__(self, arm: Arm, node_id: int) -> None:
        self._arm = arm
        self._listener = Listener(node_id)
        self._cycles: list[tuple[int, list[ContactRow]]] = []
        self.shift_ns = 0
        """From the times of the log to those of the cycles."""

    def take(self, frame: Frame, now_ns: int) -> None:
        """Take a frame; its time on the cycles' clock is ``now_ns``."""
        self.shift_ns = now_ns - frame.t_ns
        if frame.bus != 0 or frame.flags:  # contacts are published on all buses alike
            return
        n_before = self._listener.n_summaries
        self._listener.step(now_ns, (frame,))
        if self._listener.n_summaries > n_before:
            self._cycles.append((now_ns, []))
        elif self._cycles and (slot := self._listener.slot_of.get(frame.can_id)) is not None:
            row = self._listener.row(slot)
            if row is not None and row.state is not ContactState.NONE:
                self._cycles[-1][1].append(row)

    def pop(self, from_ns: int, until_ns: int) -> Records | None:
        """Return the contacts of the summary in a span of time, or None; discard older ones."""
        rows = None
        while self._cycles and self._cycles[0][0] < until_ns:
            t_ns, contacts = self._cycles.pop(0)
            if t_ns >= from_ns:
                rows = contacts
        if rows is None:
            return None
        latest = {row.slot: row for row in rows}  # a second one is for late listeners
        records = np.zeros(len(latest), CONTACT)
        for record, row in zip(records, latest.values(), strict=True):
            for name in ("id", "link", "s", "a", "force", "state"):
                record[name] = getattr(row, name)
            record["level"], record["seen_ns"] = UNKNOWN_LEVEL, from_ns
        fill_places(records, self._arm)
        return records
