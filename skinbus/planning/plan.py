"""Whether a plan holds: an arm, a bit rate, a cycle rate and a level, and what to change if it does not."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
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

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as plain values, for JSON; times in microseconds."""
        return {
            **{name: getattr(self, name) for name in ("arm", "bitrate", "data_bitrate", "rate_hz", "level")},
            "patches": self.n_patches,
            "holds": self.holds,
            "assumed": self.assumed,
            "load_pct": round(100.0 * self.load, 1),
            "cyclic_load_pct": round(100.0 * self.cyclic_load, 1),
            "response_us": _us(self.delays.response_ns),
            "compute_us": _us(self.delays.compute_ns),
            "readings_us": _us(self.readings_ns),
            "published_us": _us(self.published_ns),
            "age_us": _us(self.age_ns),
            "touch_to_contact_us": _us(self.latency_ns),
            "levels": {
                fit.level: {
                    "compute_us": _us(fit.compute_ns),
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
                    "period_us": _us(row.message.period_ns),
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


@dataclass(frozen=True)
class _Case:
    """Patches on a bus, and what it is to do."""

    ods: tuple[ObjectDictionary, ...]
    bitrate: int
    data_bitrate: int | None
    rate_hz: float
    delays: CycleDelays
    beside: Beside

    @cached_property
    def traffic(self) -> Traffic:
        """All messages."""
        return traffic(self.ods, rate_hz=self.rate_hz, data_bitrate=self.data_bitrate, beside=self.beside)

    @cached_property
    def times(self) -> dict[int, int | None]:
        """The worst time of each message by COB-ID, ns."""
        errors = self.beside.errors(self.bitrate)
        return cycle_times(self.traffic.messages, self.bitrate, self.delays, errors)

    @property
    def cyclic_load(self) -> float:
        """Share of the bus that the cycle takes."""
        return load([m for m in self.traffic.messages if m.release is not Release.SPORADIC], self.bitrate)

    def end_ns(self, release: Release) -> int | None:
        """Return when the last message of a kind is out, ns."""
        ends = [self.times[m.cob_id] for m in self.traffic.messages if m.release is release]
        known = [t for t in ends if t is not None]
        return max(known) if known and len(known) == len(ends) else None

    @property
    def holds(self) -> bool:
        """Whether load, readings, publication and every message keep their limits."""
        messages, period_ns = self.traffic.messages, SECOND / self.rate_hz
        if self.cyclic_load > MAX_LOAD or load(messages, self.bitrate) >= 1.0:
            return False
        readings_ns, published_ns = self.end_ns(Release.READING), self.end_ns(Release.PUBLISHED)
        if published_ns is None or published_ns > round(period_ns):
            return False
        if readings_ns is None or readings_ns > DEADLINE * period_ns:
            return False
        return all((t := self.times[m.cob_id]) is not None and t <= m.limit_ns for m in messages)

    @cached_property
    def largest_hz(self) -> float:
        """The largest rate at which it holds, rounded down to half a hertz; 0 for none."""
        steps = range(1, round(_HIGHEST_HZ / _RATE_STEP) + 1)
        return _RATE_STEP * bisect_left(
            steps, True, key=lambda n: not replace(self, rate_hz=n * _RATE_STEP).holds
        )


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
    cases = {
        name: _Case(
            tuple(ods_of(arm)),
            bitrate,
            arm.bus.data_bitrate,
            rate_hz,
            CycleDelays(response_ns=response_ns, compute_ns=wait_ns + compute_ns),
            beside or Beside(),
        )
        for name, compute_ns in computes_ns.items()
    }
    case = cases[level]
    published_ns = case.end_ns(Release.PUBLISHED)
    age_ns = None if published_ns is None else published_ns - frame_ns(_SYNC_BITS, bitrate)
    result = Plan(
        arm=arm.name,
        n_patches=arm.n_patches,
        bitrate=bitrate,
        data_bitrate=case.data_bitrate,
        rate_hz=rate_hz,
        level=level,
        delays=case.delays,
        load=load(case.traffic.messages, bitrate),
        cyclic_load=case.cyclic_load,
        rows=tuple(PlanRow(message=m, worst_ns=case.times[m.cob_id]) for m in case.traffic.messages),
        readings_ns=case.end_ns(Release.READING),
        published_ns=published_ns,
        age_ns=age_ns,
        latency_ns=None if age_ns is None else age_ns + round(SECOND / rate_hz),
        levels=tuple(
            LevelFit(level=name, compute_ns=computes_ns[name], holds=own.holds, largest_hz=own.largest_hz)
            for name, own in cases.items()
        ),
        warnings=(),
        holds=case.holds,
        assumed=case.beside.text,
    )
    return replace(result, warnings=tuple(_warnings(result, arm, case)))


def _warnings(plan: Plan, arm: Arm, case: _Case) -> list[str]:
    """Return what is wrong with a plan, each with what to change."""
    warnings = []
    period_ns, unpaced = SECOND / plan.rate_hz, case.traffic.unpaced
    if plan.bitrate not in cia.BIT_RATES.values():
        usual = ", ".join(f"{rate / 1e3:g}" for rate in sorted(cia.BIT_RATES.values()))
        warnings.append(
            f"{plan.bitrate} bit/s is no bit rate of CiA 301 ({usual} kbit/s): few nodes can be set to it"
        )
    if unpaced:
        warnings.append(
            f"{len(unpaced)} event-driven TPDOs have no inhibit time, so nothing bounds them "
            f"({unpaced[0]}, ...); once a cycle is assumed: set their inhibit time"
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
    return warnings + [f"what would help: {remedy}" for remedy in _remedies(plan, arm, case)]


def _remedies(plan: Plan, arm: Arm, case: _Case) -> list[str]:
    """Return changes of one thing that make the plan hold, or bring it nearest."""

    def with_eds(names: Mapping[str, str]) -> tuple[ObjectDictionary, ...]:
        return tuple(load_eds(names.get(p.eds, p.eds), p.node_id) for p in arm.patches)

    changes = {
        f"1 Mbit/s instead of {plan.bitrate} bit/s": replace(case, bitrate=MAX_BITRATE),
        '8-bit readings (eds = "skin-patch-8bit")': replace(case, ods=with_eds(NARROW_EDS)),
        'CAN FD (canfd = true, eds = "skin-patch-fd")': replace(
            case, ods=with_eds(FD_EDS), data_bitrate=plan.data_bitrate or DEFAULT_DATA_BITRATE
        ),
        "half of the patches on a second bus": replace(case, ods=case.ods[: -(-len(case.ods) // 2)]),
    }
    rate = f"at most {case.largest_hz:g} Hz instead of {plan.rate_hz:g} Hz"
    return [
        *([rate] if case.largest_hz else []),
        *(f"level {fit.level} instead of {plan.level}" for fit in plan.levels if fit.holds),
        *(
            f"{text}: up to {changed.largest_hz:g} Hz"
            for text, changed in changes.items()
            if changed.largest_hz > case.largest_hz
        ),
    ]


def _us(ns: int | None) -> float | None:
    return None if ns is None else round(ns / 1e3, 1)


def _ms(ns: int | None) -> str:
    return "any time" if ns is None else f"{ns / 1e6:.1f} ms"
