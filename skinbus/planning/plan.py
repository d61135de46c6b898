"""Whether a plan holds: an arm, a bit rate, a cycle rate and a level, and what to change if it does not."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.virtual_bus import MAX_BITRATE
from skinbus.config.arm_file import DEFAULT_DATA_BITRATE
from skinbus.config.system import ods_of
from skinbus.model import Arm, grid
from skinbus.objects.bus_load import MAX_LOAD
from skinbus.objects.eds import build_od
from skinbus.objects.eds_file import EdsFile, read_text
from skinbus.objects.new_board import NewBoard
from skinbus.objects.profile import TACTEL_COUNT, current, look_up
from skinbus.objects.readings import DEADLINE
from skinbus.planning.schedule import SECOND, ErrorModel, Message, Release, cycle_times, frame_ns, load
from skinbus.planning.traffic import BIT_ERROR_RATE, ERROR_BURST, Traffic, node_id_of, traffic

_FD_BOARDS = 'eds = "skin-patch-fd", or `skinbus board new --canfd`'
_HIGHEST_HZ = 2000.0
_SYNC_BITS = 52
"""Of a SYNC with counter until it is received, when no bit is stuffed: patches sample then."""
_RATE_STEP = 0.5
"""Rates are searched to this, Hz."""


class PlanRow(NamedTuple):
    """One message of the plan; ``worst_ns`` is None when there is no bound."""

    message: Message
    worst_ns: int | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What a bus is to do, and what becomes of it; times count from the queueing of the SYNC."""

    arm: str
    ods: tuple[ObjectDictionary, ...]
    """Of the patches."""
    bitrate: int
    data_bitrate: int | None
    """Of CAN FD; None for classic CAN."""
    rate_hz: float
    level: str
    computes_ns: Mapping[str, int]
    """Compute time of a cycle by level of the estimator."""
    response_ns: int
    """Longest time of a patch from the end of the SYNC to its readings in the send queue."""
    wait_ns: int = 0
    """Time after the last reading until those of other buses are in too."""

    @property
    def compute_ns(self) -> int:
        """Compute time of a cycle."""
        return self.computes_ns[self.level]

    @cached_property
    def traffic(self) -> Traffic:
        """All messages."""
        return traffic(self.ods, rate_hz=self.rate_hz, data_bitrate=self.data_bitrate)

    @cached_property
    def rows(self) -> tuple[PlanRow, ...]:
        """All messages with their worst times."""
        times = cycle_times(
            self.traffic.messages,
            self.bitrate,
            response_ns=self.response_ns,
            compute_ns=self.wait_ns + self.compute_ns,
            errors=ErrorModel(BIT_ERROR_RATE * self.bitrate, ERROR_BURST),  # of a bus that is always busy
        )
        return tuple(PlanRow(m, times[m.cob_id]) for m in self.traffic.messages)

    @property
    def load(self) -> float:
        """Share of the bus, everything counted at its worst."""
        return load(self.traffic.messages, self.bitrate)

    @property
    def cyclic_load(self) -> float:
        """The part of the cycle: SYNC, readings, summary and contacts."""
        return load([m for m in self.traffic.messages if m.release is not Release.SPORADIC], self.bitrate)

    def _end_ns(self, release: Release) -> int | None:
        ends = [row.worst_ns for row in self.rows if row.message.release is release]
        return None if None in ends else max(filter(None, ends), default=None)

    @property
    def readings_ns(self) -> int | None:
        """When the last reading is in."""
        return self._end_ns(Release.READING)

    @property
    def published_ns(self) -> int | None:
        """When the last contact is out."""
        return self._end_ns(Release.PUBLISHED)

    @property
    def latency_ns(self) -> int | None:
        """From a touch, a period before the SYNC is received at worst, to its contact on the bus."""
        if self.published_ns is None:
            return None
        return self.published_ns - frame_ns(_SYNC_BITS, self.bitrate) + round(SECOND / self.rate_hz)

    @property
    def faults(self) -> list[str]:
        """Which of load, readings, publication and other messages do not keep their limits."""
        faults, period_ns = [], SECOND / self.rate_hz
        if self.cyclic_load > MAX_LOAD or self.load >= 1.0:
            faults.append(
                f"the cycle fills {100 * self.cyclic_load:.0f} % of the bus ({100 * MAX_LOAD:.0f} % is the "
                f"limit), all messages at their worst {100 * self.load:.0f} %"
            )
        if self.readings_ns is None or self.readings_ns > DEADLINE * period_ns:
            faults.append(
                f"the last reading may come after {_ms(self.readings_ns)}; "
                f"the cycle closes at {DEADLINE * period_ns / 1e6:.1f} ms without it"
            )
        elif self.published_ns is None or self.published_ns > period_ns:
            faults.append(
                f"the last contact may be out after {_ms(self.published_ns)}, later than the next SYNC "
                f"({period_ns / 1e6:.1f} ms); computing takes "
                f"{(self.wait_ns + self.compute_ns) / 1e6:.2f} ms of it"
            )
        # of readings and contacts the last is judged above
        cyclic = Release.READING, Release.PUBLISHED
        slow = [
            m.name
            for m, worst_ns in self.rows
            if m.release not in cyclic and (worst_ns is None or worst_ns > m.limit_ns)
        ]
        if slow:
            faults.append(
                f"messages later than they may be: {', '.join(slow[:4])}" + ", ..." * (len(slow) > 4)
            )
        return faults

    @cached_property
    def holds(self) -> bool:
        """Whether everything keeps its limits."""
        return not self.faults

    @cached_property
    def largest_hz(self) -> float:
        """The largest rate at which it holds, rounded down to half a hertz; 0 for none."""
        steps = range(1, round(_HIGHEST_HZ / _RATE_STEP) + 1)
        return _RATE_STEP * bisect_left(
            steps, True, key=lambda n: not replace(self, rate_hz=n * _RATE_STEP).holds
        )

    @cached_property
    def levels(self) -> tuple[Plan, ...]:
        """The same with each level of the estimator."""
        return tuple(replace(self, level=level) for level in self.computes_ns)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the plan, and what to change."""
        warnings, unpaced = [], self.traffic.unpaced
        if self.data_bitrate and not any(message.data_bits for message in self.traffic.messages):
            warnings.append(
                "canfd = true changes nothing: no board of this bus sends more than 8 bytes in a frame; "
                f"boards for CAN FD do ({_FD_BOARDS})"
            )
        if unpaced:
            warnings.append(
                f"{len(unpaced)} event-driven TPDOs have no inhibit time, so nothing bounds them "
                f"({unpaced[0]}, ...); once a cycle is assumed: set their inhibit time"
            )
        if self.holds:
            return tuple(warnings)
        return *warnings, *self.faults, *(f"what would help: {remedy}" for remedy in self._remedies())

    def _remedies(self) -> list[str]:
        """Return changes of one thing that make the plan hold, or bring it nearest."""

        n_tactels = [int(str(current(look_up(od, TACTEL_COUNT)))) for od in self.ods]
        narrow, fd = (
            tuple(
                build_od(_new_board(n, canfd), node_id_of(od))
                for n, od in zip(n_tactels, self.ods, strict=True)
            )
            for canfd in (False, True)
        )
        changes: dict[str, dict[str, Any]] = {
            f"1 Mbit/s instead of {self.bitrate} bit/s": {"bitrate": MAX_BITRATE},
            '8-bit readings (eds = "skin-patch-8bit", or `skinbus board new --bits 8`)': {"ods": narrow},
            "half of the patches on a second bus": {"ods": self.ods[: -(-len(self.ods) // 2)]},
            f"CAN FD ({_FD_BOARDS}, canfd = true)": {
                "ods": fd, "data_bitrate": self.data_bitrate or DEFAULT_DATA_BITRATE
            },
        }  # fmt: skip
        reached = {text: replace(self, **change).largest_hz for text, change in changes.items()}
        least = next((text for text, hz in reached.items() if hz >= self.rate_hz), None)
        rate = f"at most {self.largest_hz:g} Hz instead of {self.rate_hz:g} Hz"
        return [
            *([rate] if self.largest_hz else []),
            *(f"level {fit.level} instead of {self.level}" for fit in self.levels if fit.holds),
            *(
                f"{text}: up to {hz:g} Hz" + ", the least change that is enough" * (text == least)
                for text, hz in reached.items()
                if hz > self.largest_hz
            ),
        ]


def plans(
    arm: Arm,
    computes_ns: Mapping[str, int],
    *,
    level: str,
    bitrate: int | None = None,
    rate_hz: float | None = None,
    response_ns: int = 0,
) -> list[Plan]:
    """Return the plans of all buses of an arm; contacts are computed when the last reading of all is in.

    computes_ns:  compute time of a cycle by level; ``level`` is the one the verdict is about.
    bitrate:      bit/s, and ``rate_hz`` the SYNC rate: those of the arm file unless given.
    response_ns:  longest time of a patch from the end of the SYNC to its readings in the send queue.
    """
    several = len(arm.buses) > 1
    alone = [
        Plan(
            arm=f"{arm.name}, bus {bus.name}" if several else arm.name,
            ods=tuple(ods_of(arm.part(k))),
            bitrate=bitrate or bus.bitrate,
            data_bitrate=bus.data_bitrate,
            rate_hz=rate_hz or arm.bus.rate_hz,
            level=level,
            computes_ns=computes_ns,
            response_ns=response_ns,
        )
        for k, bus in enumerate(arm.buses)
    ]
    last_ns = max(own.readings_ns or 0 for own in alone)
    return [replace(own, wait_ns=last_ns - (own.readings_ns or 0)) for own in alone]


@cache
def _new_board(n_tactels: int, canfd: bool) -> EdsFile:
    """Return a board of so many tactels with 8-bit readings, or for CAN FD."""
    board = NewBoard(name="", tactels_uv=grid(n_tactels, 1, 10e-3), pitch=10e-3, bits=8, canfd=canfd)
    return read_text(board.text(), name="a new board")


def _ms(ns: int | None) -> str:
    return "any time" if ns is None else f"{ns / 1e6:.1f} ms"
