"""The whole road on a simulated wire: latency and error against patches on a bus, 16-bit and 8-bit.

Patches, master and wire are the ones that run everywhere else; only the clock is virtual. The rate is that
of the arm file of a user who asks ``skinbus plan``: the largest that holds, or fewer. Computing takes no
time on the virtual clock, so the latency is that of the wire and of the order of things on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from skinbus.errors import SkinbusError
from skinbus.master import CycleReport, Master
from skinbus.model import Arm, BusSettings, Link, PlacedPatch, Surface
from skinbus.objects import cia
from skinbus.objects.arm import ods_of
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim import Scene, Touch, World
from skinbus.sim.effects.noise import Noise
from skinbus.sim.laws import Elastic
from skinbus.sim.touch import Shape
from skinbus.study.plan import largest_rate
from skinbus.study.schedule import CycleDelays, cycle_times
from skinbus.study.score import Points, Score
from skinbus.study.traffic import Beside, traffic

PER_ROW: Final = 8
_PITCH = 0.051
_TOUCHES = 5
_BOOT_LIMIT_NS = 60_000_000_000
_DURATION_S = 3600.0
_FIRST_CONTACT, _LAST_CONTACT = 0x681, 0x690


class Wire(Protocol):
    """The part of ``bus.wire.Wire`` that is needed; the study does not import the bus."""

    def attach(self, core: Any) -> Any:
        """Put a core on the bus."""

    def run(self, until_ns: int) -> None:
        """Let everything happen up to a time."""

    def tap(self, listen: Callable[[Any], object]) -> Any:
        """Let somebody see every frame at its end."""

    def load(self) -> float:
        """Return the share of the last second in which the bus was taken."""


WireOf = Callable[[int], Wire]
"""Makes a wire of a bit rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadRow:
    """What a bus full of patches does, measured and by the analysis; latency counts from the end of SYNC."""

    eds: str
    patches: int
    rate_hz: float
    cycles: int
    load_pct: float
    latency_mean_ms: float
    """SYNC to the last contact TPDO."""
    latency_max_ms: float
    bound_ms: float
    position_median_mm: float
    force_median_pct: float
    missed: int


def arm_of(n_patches: int, eds: str, rate_hz: float, bitrate: int = 1_000_000) -> Arm:
    """Return a plate with patches side by side, eight in a row."""
    rows = -(-n_patches // PER_ROW)
    link = Link("plate", Surface.plane(rows * _PITCH, PER_ROW * _PITCH))
    patch = describe_patch(load_eds(eds, 1), eds)
    placed = [
        PlacedPatch(
            patch=patch,
            node_id=k + 1,
            link=0,
            s=(k // PER_ROW + 0.5) * _PITCH,
            a=(k % PER_ROW - 0.5 * (PER_ROW - 1)) * _PITCH,
            eds=eds,
        )
        for k in range(n_patches)
    ]
    return Arm(f"{n_patches} patches", [link], placed, BusSettings(bitrate=bitrate, rate_hz=rate_hz))


def measure_road(
    n_patches: int,
    eds: str,
    wire_of: WireOf,
    *,
    rate_hz: float | None = None,
    level: str = "fit",
    cycles: int = 50,
) -> RoadRow:
    """Return what a bus with so many patches does; at the largest rate that holds if none is given."""
    n_touches = min(_TOUCHES, n_patches)
    beside = Beside(contacts=16)
    if rate_hz is None:
        ods = ods_of(arm_of(n_patches, eds, 1.0))
        rate_hz = min(200.0, largest_rate(ods, 1_000_000, CycleDelays(), beside))
    arm = arm_of(n_patches, eds, rate_hz)
    scene = _scene(arm, n_touches)
    score = Score(arm)
    reports: list[CycleReport] = []
    master = Master(arm, level=level, on_cycle=reports.append)
    wire = wire_of(arm.bus.bitrate)
    wire.attach(World(scene))
    wire.attach(master)

    period_ns = round(1e9 / rate_hz)
    now_ns = _run_until_all_send(wire, reports, n_patches, period_ns)
    del reports[:]
    latencies = _watch_latency(wire)
    wire.run(now_ns + cycles * period_ns)

    truth = scene.touches_at(1.0)
    touches = Points(truth.touch, truth.link, truth.s, truth.a, truth.force)
    for report in reports:
        c = report.contacts
        score.add(touches, Points(report.ids, c.link, c.s, c.a, c.force))
    messages = traffic(ods_of(arm), rate_hz=rate_hz, beside=Beside(contacts=n_touches)).messages
    bounds = cycle_times(messages, arm.bus.bitrate)
    known = [bounds[m.cob_id] for m in messages if m.name.startswith("contact")]
    bound_ns = max((t for t in known if t is not None), default=0)
    return RoadRow(
        eds=eds,
        patches=n_patches,
        rate_hz=rate_hz,
        cycles=len(reports),
        load_pct=100.0 * wire.load(),
        latency_mean_ms=float(np.mean(latencies)) / 1e6,
        latency_max_ms=float(np.max(latencies)) / 1e6,
        bound_ms=bound_ns / 1e6,
        position_median_mm=score.position_mm()["median"],
        force_median_pct=score.force_pct()["median"],
        missed=score.missed,
    )


def _run_until_all_send(wire: Wire, reports: list[CycleReport], n_patches: int, period_ns: int) -> int:
    """Let the patches boot; return the bus time at which a cycle had the readings of all."""
    now_ns = 0
    while not (reports and reports[-1].n_fresh == n_patches):
        now_ns += period_ns
        if now_ns > _BOOT_LIMIT_NS:
            raise SkinbusError(f"{n_patches} patches have not all booted within {_BOOT_LIMIT_NS / 1e9:g} s")
        wire.run(now_ns)
    return now_ns


def _watch_latency(wire: Wire) -> list[int]:
    """Return a list that fills with the time from each SYNC to the last contact TPDO of its cycle, ns."""
    latencies: list[int] = []
    sync_ns = last_ns = 0

    def note(frame: Any) -> None:
        nonlocal sync_ns, last_ns
        if frame.can_id == cia.SYNC_ID:
            if last_ns > sync_ns > 0:
                latencies.append(last_ns - sync_ns)
            sync_ns = frame.t_ns
        elif _FIRST_CONTACT <= frame.can_id <= _LAST_CONTACT:
            last_ns = frame.t_ns

    wire.tap(note)
    return latencies


def _scene(arm: Arm, n_touches: int) -> Scene:
    """Return fingertips that keep pressing all over an arm, off the centres of the boards."""
    step = arm.n_patches // n_touches
    touches = []
    for k in range(n_touches):
        placed = arm.patches[k * step]
        path = np.array([[0.0, placed.s + 0.004, placed.a - 0.006]])
        keys = np.array([[0.0, 6.0], [_DURATION_S, 6.0]])
        touches.append(Touch(link=0, path=path, force=keys, shape=Shape.DISC, length=0.012))
    return Scene(
        "road", arm, duration_s=_DURATION_S, layer=Elastic(), touches=touches, effects=[Noise(sigma_pa=200.0)]
    )
