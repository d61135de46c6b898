"""The skin in a recording: its readings through the master that runs on a live bus, on its own time."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from skinbus.can.candump import CandumpReader
from skinbus.can.event import Event
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm
from skinbus.errors import AddressError, ConfigError
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.formatting import counted
from skinbus.master import CycleReport
from skinbus.master.replay import Replay, find_sync
from skinbus.model import Arm
from skinbus.skin.addresses import channels_by_name, how_to_say
from skinbus.skin.contact import Level
from skinbus.skin.cycle import Cycle
from skinbus.skin.master_cycles import CycleMaker, played
from skinbus.skin.opened import Channel, channel_words, check_level, saying_why
from skinbus.skin.skin import Skin

HEAD = 20_000
"""Frames, some seconds of a full bus, from which interfaces and rate are found before the work begins."""

MOST_BACK = 0.1
"""Share of frames that may have an earlier time than the one before: several interfaces are read in turns."""

SAME_RATE = 0.05
"""A recording whose rate is this near to that of the arm file has that rate."""


def replay(
    log: str | Path,
    arm: str | Path | Arm,
    *,
    channel: Channel = None,
    level: Level = DEFAULT_LEVEL,
    zero: bool = False,
    realtime: bool = False,
) -> Skin:
    """Make the contacts of a recording again.

    Times count from the first frame.

    Args:
        log: of ``skinbus record`` or candump, also compressed (.gz).
        arm: name or TOML file of the arm whose patches were recorded.
        channel: interface in the log; of several buses a mapping from their names; by default what the arm
            file says, or the only one in the log.
        level: of the estimator, "kmeans", "fit" or "full".
        zero: take what each patch reads first for its zero.
        realtime: let time go on by itself, slower where the machine is too slow; otherwise a cycle is made
            when it is asked for, as fast as possible.

    Raises:
        ConfigError: arm or log have faults, or the log holds no readings of this arm; FileNotFoundError too
            where there is none.
        AddressError: which interface of the log is meant is not clear.
        ArgumentError: there is no such level.
    """
    check_level(level)
    loaded = arm if isinstance(arm, Arm) else load_arm(arm, check_load=False)
    with saying_why():
        source = Replayed(log, loaded, channel_words(channel), level=level, zero=zero)

    def cycles() -> Iterator[Cycle]:
        yield from source
        if not source.replay.taken.n_readings:
            wanted = f"readings of {source.arm.name}: it has none"
            raise ConfigError.of(source.reader.name, "log", None, wanted)

    return played(f"recording {log}", cycles(), source.maker, source.replay.master, realtime=realtime)


class Replayed:
    """The cycles of a recording as a master makes them again; to be gone through once."""

    def __init__(
        self,
        log: str | Path | TextIO,
        arm: Arm,
        channels: Sequence[str] = (),
        *,
        level: str,
        zero: bool,
        on_event: Callable[[Event], Any] = lambda event: None,
    ) -> None:
        """Read the head of a log; ``channels`` are interfaces in it, by bus or as NAME=CHANNEL.

        Raises:
            ConfigError: the log cannot be read, holds no frame, or its times are none.
            AddressError: which interface is which bus cannot be decided.
        """
        self.reader = CandumpReader(log)
        self._lines = iter(self.reader)
        self._head = list(islice(self._lines, HEAD))
        _check_times(self.reader.name, self._head)
        self._buses = _buses_of(arm, channels, Counter(name for _, name in self._head), self.reader.name)
        self.sync = find_sync(
            frame._replace(bus=self._buses[name]) for frame, name in self._head if name in self._buses
        )
        """What its cycles begin with."""
        rate_hz = self.sync.rate_hz or arm.bus.rate_hz
        is_same = abs(rate_hz / arm.bus.rate_hz - 1.0) <= SAME_RATE
        self.arm = arm if is_same else arm.with_rate(rate_hz)
        """The arm at the rate of the recording."""
        self.elsewhere: Counter[str] = Counter()
        """Frames of other interfaces so far, by name; they are left out."""
        self.maker = CycleMaker(self.arm)
        self._new = deque[Any]()
        self.replay = Replay(
            self.arm,
            sync_bus=self.sync.bus,
            on_cycle=self._take,
            on_event=on_event,
            level=level,
            zero_at_start=zero,
        )

    def __iter__(self) -> Iterator[Any]:
        for frame, name in chain(self._head, self._lines):
            bus = self._buses.get(name)
            if bus is None:
                self.elsewhere[name] += 1
                continue
            self.replay.take(frame._replace(bus=bus) if bus else frame)
            while self._new:
                yield self._new.popleft()
        self.replay.end()
        yield from self._new

    def made(self, cycle: Cycle, report: CycleReport) -> Any:
        """Return what is gone through for a cycle."""
        return cycle

    def _take(self, report: CycleReport) -> None:
        self._new.append(self.made(self.maker.make(self.replay.master, report), report))


def _check_times(name: str, head: Sequence[tuple[Frame, str]]) -> None:
    """Raise ConfigError when the times of a log are none: candump -td shows pauses in their place."""
    n_back = int((np.diff([frame.t_ns for frame, _ in head]) < 0).sum())
    if n_back > MOST_BACK * len(head):
        seen = f"{n_back} of {len(head)} go back"
        raise ConfigError.of(name, "times", seen, "times of frames, as of candump -l")


def _buses_of(arm: Arm, channels: Sequence[str], seen: Mapping[str, int], log: str) -> dict[str, int]:
    """Return the bus of the arm that each interface in the log is; ``seen`` are those there by name."""
    said = channels_by_name(arm.buses, channels)
    there = ", ".join(f"{name} ({counted(n, 'frame')})" for name, n in sorted(seen.items()))
    names: list[str] = []
    faults: list[str] = []
    for settings, name in zip(arm.buses, said, strict=True):
        if name is None and settings.channel in seen:
            name = settings.channel
        if name is None and len(arm.buses) == len(seen) == 1:
            (name,) = seen
        if name is None and len(arm.buses) == 1:
            faults.append("say by --channel (channel=... in Python) which of them is meant")
        elif name is None:
            faults.append(f"say by {how_to_say(settings)} which of them bus {settings.name} is")
        elif name in names:
            faults.append(f"bus {settings.name} is on {name}, as another bus is")
        else:
            names.append(name)
    if faults:
        raise AddressError(f"{log} begins with {there}: {'; '.join(faults)}")
    return {name: k for k, name in enumerate(names)}
