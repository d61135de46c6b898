"""Whether a plan holds: an arm, a bit rate, a cycle rate and a level, and what to change if it does not."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.virtual_bus import MAX_BITRATE
from skinbus.config.arm_file import DEFAULT_DATA_BITRATE
from skinbus.config.system import ods_of
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.objects.bus_load import MAX_LOAD
from skinbus.objects.eds import load_eds
from skinbus.objects.readings import DEADLINE
from skinbus.planning.schedule import (
    SECOND,
    CycleDelays,
    ErrorModel,
    Message,
    Release,
    cycle_times,
    frame_ns,
    load,
)
from skinbus.planning.traffic import Beside, Traffic, traffic

NARROW_EDS: Final = {"skin-patch": "skin-patch-8bit"}
"""Boards that ship with an EDS of fewer bits."""
FD_EDS: Final = {"skin-patch": "skin-patch-fd"}
"""Boards that ship with an EDS for CAN FD."""
_HIGHEST_HZ: Final = 2000.0
_SYNC_BITS: Final = 52
"""Of a SYNC with counter until it is received, when no bit is stuffed: patches sample then."""
_RATE_STEP: Final = 0.5
"""Rates are searched to this, Hz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRow:
    """One message of the plan; ``worst_ns`` is None when there is no bound."""

    message: Message
    worst_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelFit:
    """What a level of the estimator means for the cycle."""

    level: str
    compute_ns: int
    holds: bool
    largest_hz: float
    """Largest rate at which everything holds with this level; 0 when none does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The verdict, and everything it rests on; times count from the queueing of the SYNC."""

    arm: str
    n_patches: int
    bitrate: int
    data_bitrate: int | None
    """Of CAN FD; None for classic CAN."""
    rate_hz: float
    level: str
    delays: CycleDelays
    load: float
    """Share of the bus, everything counted at its worst."""
    cyclic_load: float
    """The part of the cycle: SYNC, readings, summary and contacts."""
    rows: tuple[PlanRow, ...]
    readings_ns: int | None
    """When the last reading is in."""
    published_ns: int | None
    """When the last contact is out."""
    age_ns: int | None
    """Age of the readings behind the last contact when it is out: since the patches received the SYNC."""
    latency_ns: int | None
    """From a touch, at the worst moment, to its contact on the bus: a period more than the age."""
    levels: tuple[LevelFit, ...]
    warnings: tuple[str, ...]
    holds: bool
    assumed: str
    """What may happen beside the cycle, at most."""
    most_emergencies: int
    """EMCY messages a second with which it still holds, up to one from each patch."""

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as plain values, for JSON; times in microseconds."""
        return {
            "arm": self.arm,
            "patches": self.n_patches,
            "bitrate": self.bitrate,
            "data_bitrate": self.data_bitrate,
            "rate_hz": self.rate_hz,
            "level": self.level,
            "holds": self.holds,
            "assumed": self.assumed,
            "most_emergencies": self.most_emergencies,
            "load_pct": round(100.0 * self.load, 1),
            "cyclic_load_pct": round(100.0 * self.cyclic_load, 1),
            "response_us": self.delays.response_ns / 1e3,
            "compute_us": self.delays.compute_ns / 1e3,
            "readings_us": _us(self.readings_ns),
            "published_us": _us(self.published_ns),
            "age_us": _us(self.age_ns),
            "touch_to_contact_us": _us(self.latency_ns),
            "levels": {
                fit.level: {
                    "compute_us": fit.compute_ns / 1e3,
                    "holds": fit.holds,
                    "largest_hz": fit.largest_hz,
                }
                for fit in self.levels
            },
            "warnings": list(self.warnings),
            "messages": [
                {
                    "name": row.message.name,
                    "cob_id": f"0x{row.message.cob_id:03X}",
                    "bits": row.message.bits,
                    "data_bits": row.message.data_bits,
                    "period_us": row.message.period_ns / 1e3,
                    "release": row.message.release.value,
                    "worst_us": _us(row.worst_ns),
                }
                for row in self.rows
            ],
        }


def plans(arm: Arm, computes_ns: Mapping[str, int], *, response_ns: int = 0, **settings: Any) -> list[Plan]:
    """Return the plans of all buses of an arm; ``settings`` are those of :func:`plan`.

    Contacts are computed when the last reading of all buses is in.
    """
    parts = [arm.part(k) for k in range(len(arm.buses))]
    alone = [plan(part, computes_ns, response_ns=response_ns, **settings) for part in parts]
    if len(parts) == 1:
        return alone
    last_ns = max((own.readings_ns or 0 for own in alone), default=0)
    together = [
        plan(part, computes_ns, response_ns=response_ns, wait_ns=last_ns - (own.readings_ns or 0), **settings)
        for part, own in zip(parts, alone, strict=True)
    ]
    return [
        replace(own, arm=f"{arm.name}, bus {bus.name}") for own, bus in zip(together, arm.buses, strict=True)
    ]


def plan(
    arm: Arm,
    computes_ns: Mapping[str, int],
    *,
    level: str,
    bitrate: int | None = None,
    rate_hz: float | None = None,
    response_ns: int = 0,
    wait_ns: int = 0,
    beside: Beside | None = None,
) -> Plan:
    """Return the plan of an arm with one bus.

    computes_ns:  compute time of a cycle by level; ``level`` is the one the verdict is about.
    bitrate:      bit/s, and ``rate_hz`` the SYNC rate: those of the arm file unless given.
    response_ns:  longest time of a patch from the end of the SYNC to its readings in the send queue.
    wait_ns:      time after the last reading until those of other buses are in too.
    """
    if level not in computes_ns:
        raise ValueError(f"level is {level!r}; compute times are known of {', '.join(computes_ns)}")
    bitrate, rate_hz = bitrate or arm.bus.bitrate, rate_hz or arm.bus.rate_hz
    if not 0.0 < rate_hz <= _HIGHEST_HZ:
        raise ValueError(f"rate_hz is {rate_hz}; wanted above 0 and at most {_HIGHEST_HZ}")
    beside = beside or Beside()
    ods = ods_of(arm)
    delays = CycleDelays(response_ns=response_ns, compute_ns=wait_ns + computes_ns[level])
    data_bitrate = arm.bus.data_bitrate
    now = traffic(ods, rate_hz=rate_hz, data_bitrate=data_bitrate, beside=beside)
    errors = beside.errors(bitrate)
    times = cycle_times(now.messages, bitrate, delays, errors)
    readings_ns, published_ns = _ends(now.messages, times)
    holds = _holds(now.messages, bitrate, delays, errors, times)

    fits = []
    for name, compute_ns in computes_ns.items():
        its = replace(delays, compute_ns=wait_ns + compute_ns)
        largest = largest_rate(ods, bitrate, its, beside, data_bitrate)
        fits.append(
            LevelFit(
                level=name,
                compute_ns=compute_ns,
                holds=_holds(now.messages, bitrate, its, errors),
                largest_hz=largest,
            )
        )
    (sync,) = [m for m in now.messages if m.release is Release.SYNC]
    age_ns = None if published_ns is None else published_ns - frame_ns(_SYNC_BITS, bitrate)
    result = Plan(
        arm=arm.name,
        n_patches=arm.n_patches,
        bitrate=bitrate,
        data_bitrate=data_bitrate,
        rate_hz=rate_hz,
        level=level,
        delays=delays,
        load=load(now.messages, bitrate),
        cyclic_load=_cyclic_load(now.messages, bitrate),
        rows=tuple(PlanRow(message=m, worst_ns=times[m.cob_id]) for m in now.messages),
        readings_ns=readings_ns,
        published_ns=published_ns,
        age_ns=age_ns,
        latency_ns=None if age_ns is None else age_ns + sync.period_ns,
        levels=tuple(fits),
        warnings=(),
        holds=holds,
        assumed=beside.text,
        most_emergencies=_most_emergencies(ods, rate_hz, bitrate, delays, beside, data_bitrate),
    )
    return replace(result, warnings=tuple(_warnings(result, arm, now, beside)))


def _ends(messages: Sequence[Message], times: Mapping[int, int | None]) -> tuple[int | None, int | None]:
    """Return when the last reading is in and when the last contact is out, ns."""
    ends: list[int | None] = []
    for release in (Release.READING, Release.PUBLISHED):
        own = [times[m.cob_id] for m in messages if m.release is release]
        known = [t for t in own if t is not None]
        ends.append(max(known) if own and len(known) == len(own) else None)
    return ends[0], ends[1]


def _holds(
    messages: Sequence[Message],
    bitrate: int,
    delays: CycleDelays,
    errors: ErrorModel,
    times: Mapping[int, int | None] | None = None,
) -> bool:
    """Return whether load, readings, publication and every message keep their limits."""
    if _cyclic_load(messages, bitrate) > MAX_LOAD or load(messages, bitrate) >= 1.0:
        return False
    times = cycle_times(messages, bitrate, delays, errors) if times is None else times
    (period,) = [m.period_ns for m in messages if m.release is Release.SYNC]
    readings_ns, published_ns = _ends(messages, times)
    if published_ns is None or published_ns > period:
        return False
    if readings_ns is None or readings_ns > DEADLINE * period:
        return False
    return all((t := times[m.cob_id]) is not None and t <= m.limit_ns for m in messages)


def _most_emergencies(
    ods: Sequence[ObjectDictionary],
    rate_hz: float,
    bitrate: int,
    delays: CycleDelays,
    beside: Beside,
    data_bitrate: int | None,
) -> int:
    """Return with how many EMCY messages a second the plan holds, -1: with none."""

    def holds(n: int) -> bool:
        faulty = replace(beside, emergencies=n)
        now = traffic(ods, rate_hz=rate_hz, data_bitrate=data_bitrate, beside=faulty)
        return _holds(now.messages, bitrate, delays, beside.errors(bitrate))

    return bisect_left(range(len(ods) + 1), True, key=lambda n: not holds(n)) - 1


def _cyclic_load(messages: Sequence[Message], bitrate: int) -> float:
    return load([m for m in messages if m.release is not Release.SPORADIC], bitrate)


def largest_rate(
    ods: Sequence[ObjectDictionary],
    bitrate: int,
    delays: CycleDelays,
    beside: Beside,
    data_bitrate: int | None = None,
) -> float:
    """Return the largest rate at which the plan holds, Hz, rounded down to half a hertz."""

    def holds(steps: int) -> bool:
        rate_hz = steps * _RATE_STEP
        now = traffic(ods, rate_hz=rate_hz, data_bitrate=data_bitrate, beside=beside)
        return _holds(now.messages, bitrate, delays, beside.errors(bitrate))

    low, high = 0, round(_HIGHEST_HZ / _RATE_STEP) + 1
    while high - low > 1:
        middle = (low + high) // 2
        if holds(middle):
            low = middle
        else:
            high = middle
    return low * _RATE_STEP


def _warnings(plan: Plan, arm: Arm, now: Traffic, beside: Beside) -> list[str]:
    """Return what is wrong with a plan, each with what to change."""
    warnings = []
    period_ns = SECOND / plan.rate_hz
    (own,) = [fit for fit in plan.levels if fit.level == plan.level]
    if plan.bitrate not in cia.BIT_RATES.values():
        usual = ", ".join(f"{rate / 1e3:g}" for rate in sorted(cia.BIT_RATES.values()))
        warnings.append(
            f"{plan.bitrate} bit/s is no bit rate of CiA 301 ({usual} kbit/s): few nodes can be set to it"
        )
    if now.unpaced:
        warnings.append(
            f"{len(now.unpaced)} event-driven TPDOs have no inhibit time, so nothing bounds them "
            f"({now.unpaced[0]}, ...); once a cycle is assumed: set their inhibit time"
        )
    if plan.holds:
        return warnings
    if plan.cyclic_load > MAX_LOAD:
        warnings.append(
            f"the cycle fills {100 * plan.cyclic_load:.0f} % of the bus; {100 * MAX_LOAD:.0f} % is the limit"
        )
    if plan.readings_ns is None or plan.readings_ns > DEADLINE * period_ns:
        warnings.append(
            f"the last reading may come after {_ms(plan.readings_ns)}; "
            f"the cycle closes at {DEADLINE * period_ns / 1e6:.1f} ms without it"
        )
    elif plan.published_ns is None or plan.published_ns > period_ns:
        warnings.append(
            f"the last contact may be out after {_ms(plan.published_ns)}, later than the next SYNC "
            f"({period_ns / 1e6:.1f} ms); computing takes {plan.delays.compute_ns / 1e6:.2f} ms of it"
        )
    # The cycle's own messages are judged above; SDO and heartbeats may suffer alone.
    slow = [
        row.message.name
        for row in plan.rows
        if row.message.release is Release.SPORADIC
        and (row.worst_ns is None or row.worst_ns > row.message.limit_ns)
    ]
    if slow:
        warnings.append(f"messages later than they may be: {', '.join(slow[:4])}" + ", ..." * (len(slow) > 4))
    return warnings + [f"what would help: {remedy}" for remedy in _remedies(plan, own, arm, beside)]


def _remedies(plan: Plan, own: LevelFit, arm: Arm, beside: Beside) -> list[str]:
    """Return changes of one thing that make the plan hold, or bring it nearest."""
    remedies = []
    if own.largest_hz:
        remedies.append(f"at most {own.largest_hz:g} Hz instead of {plan.rate_hz:g} Hz")
    for fit in plan.levels:
        if fit.holds:
            remedies.append(f"level {fit.level} instead of {plan.level}")
    if plan.bitrate < MAX_BITRATE:
        largest = largest_rate(ods_of(arm), MAX_BITRATE, plan.delays, beside, plan.data_bitrate)
        remedies.append(f"1 Mbit/s instead of {plan.bitrate} bit/s: up to {largest:g} Hz")
    if any(placed.eds in NARROW_EDS for placed in arm.patches):
        ods = [load_eds(NARROW_EDS.get(p.eds, p.eds), p.node_id) for p in arm.patches]
        largest = largest_rate(ods, plan.bitrate, plan.delays, beside, plan.data_bitrate)
        if largest > own.largest_hz:
            remedies.append(f'8-bit readings (eds = "skin-patch-8bit"): up to {largest:g} Hz')
        ods = [load_eds(FD_EDS.get(p.eds, p.eds), p.node_id) for p in arm.patches]
        largest = largest_rate(
            ods, plan.bitrate, plan.delays, beside, plan.data_bitrate or DEFAULT_DATA_BITRATE
        )
        if largest > own.largest_hz:
            remedies.append(f'CAN FD (canfd = true, eds = "skin-patch-fd"): up to {largest:g} Hz')
    if arm.n_patches > 1:
        half = ods_of(arm)[: -(-arm.n_patches // 2)]
        largest = largest_rate(half, plan.bitrate, plan.delays, beside, plan.data_bitrate)
        if largest > own.largest_hz:
            remedies.append(f"half of the patches on a second bus: up to {largest:g} Hz")
    return remedies


def _us(ns: int | None) -> float | None:
    return None if ns is None else round(ns / 1e3, 1)


def _ms(ns: int | None) -> str:
    return "any time" if ns is None else f"{ns / 1e6:.1f} ms"
