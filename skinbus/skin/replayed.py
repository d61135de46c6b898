"""The skin in a recording: its readings through the master that runs on a live bus, on its own time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from skinbus.can.frame import Frame
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError, Fault
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.master import CycleReport
from skinbus.master.replay import Replay
from skinbus.model import Arm
from skinbus.skin.compile_ahead import parts_of
from skinbus.skin.cycle import Cycle
from skinbus.skin.feed import PacedClock, PacedFeed, PullFeed
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.opened import channel_words, check_level, compile_kernels, offer, set_zero
from skinbus.skin.recording import Recording
from skinbus.skin.skin import Skin


def replay(
    log: str | Path,
    arm: str | Path | Arm,
    *,
    channel: str | Mapping[str, str] | None = None,
    level: str = DEFAULT_LEVEL,
    zero: bool = False,
    realtime: bool = False,
) -> Skin:
    """Make the contacts of a recording again.

    log:      of ``skinbus record`` or candump, also compressed (.gz)
    arm:      name or TOML file of the arm whose patches were recorded
    channel:  interface in the log; of several buses a mapping from their names; by default what the arm file
              says, or the only one in the log
    level:    of the estimator, "kmeans", "fit" or "full"
    zero:     take what each patch reads first for its zero
    realtime: let time go on by itself; otherwise a cycle is made when it is asked for, as fast as possible

    Times count from the first frame.

    Raises:
        ConfigError: arm or log have faults, or the log holds no readings of this arm.
        AddressError: which interface of the log is meant is not clear.
        ArgumentError: there is no such level.
    """
    check_level(level)
    loaded = arm if isinstance(arm, Arm) else load_arm(arm, check_load=False)
    recording = Recording(log, loaded, channel_words(channel))
    clock = PacedClock() if realtime else None
    maker = CycleMaker(recording.arm, clock)
    played = Played(recording, maker, level, zero)
    master = played.replay.master
    feed = PullFeed(maker.layout, played.next_cycle, partial(set_zero, master), partial(offer, master))
    return Skin(PacedFeed(feed, clock) if clock else feed)


class Played:
    """Frames of a recording, handed on until the next cycle has ended."""

    def __init__(
        self,
        recording: Recording,
        maker: CycleMaker,
        level: str,
        zero: bool,
        *,
        on_frame: Callable[[Frame, int], None] | None = None,
    ) -> None:
        """``on_frame`` is called with each frame that was taken, and its time on the cycles' clock (ns)."""
        self._recording = recording
        self._on_frame = on_frame
        self._frames = iter(recording)
        self._maker = maker
        self._new: deque[Cycle] = deque()
        self._has_ended = False
        compile_kernels(parts_of(level))
        self.replay = Replay(
            recording.arm,
            sync_bus=recording.sync.bus,
            on_cycle=self._on_cycle,
            level=level,
            zero_at_start=zero,
        )

    def next_cycle(self) -> Cycle | None:
        """Return the next cycle, None at the end of the recording."""
        while not self._new:
            if self._has_ended:
                return None
            frame = next(self._frames, None)
            if frame is None:
                self._has_ended = True
                self.replay.end()
                if not self.replay.taken.n_readings:
                    wanted = f"readings of {self._recording.arm.name}: it has none"
                    raise ConfigError(self._recording.reader.name, [Fault("log", None, wanted)])
            else:
                self.replay.take(frame)
                if self._on_frame:
                    self._on_frame(frame, self.replay.timeline.now_ns)
        return self._new.popleft()

    def _on_cycle(self, report: CycleReport) -> None:
        self._new.append(self._maker.make(self.replay.master, report))
