"""The whole pipeline on the virtual bus: latency and error against patches on a bus, 16-bit and 8-bit.

Patches send with SYNC, or on a change (see ``onchange``). Patches, master and wire are the ones that run
everywhere else; only the clock is virtual. The rate is that of the arm file of a user who asks
``skinbus plan``: the largest that holds, or fewer. Computing takes no time on the virtual clock, so the
latency is that of the wire and of the order of things on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import ods_of
from skinbus.errors import SkinbusError
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.master import CycleReport, Master
from skinbus.model import Arm, BusSettings, Link, PlacedPatch, Surface
from skinbus.objects import cia
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.objects.published import usual
from skinbus.objects.readings import ReadingsPlan
from skinbus.planning.plan import largest_rate
from skinbus.planning.schedule import CycleDelays, cycle_times
from skinbus.planning.traffic import Beside, traffic
from skinbus.sim import Scene, Touch, World
from skinbus.sim.effects.noise import Noise
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.touch import Touches
from skinbus.study.event_driven import OnChange, send_on_change
from skinbus.study.score import Points, Score

PER_ROW: Final = 8
_PITCH = 0.051
_TOUCHES = 5
_BOOT_LIMIT_NS = 60_000_000_000
_DURATION_S = 120.0
_PULSE_S = 0.4
_FORCES = (8.0, 4.0)
"""N: every touch moves between them within half a pulse."""
_ALL_BOOTED_NS = 2_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class EndToEndRow:
    """What a bus full of patches does, measured and by the analysis; latency counts from the end of SYNC."""

    eds: str
    mode: str
    """"sync", or "change": what moves is sent when it does."""
    patches: int
    rate_hz: float
    """Of the SYNC, or of the samples that patches take by themselves."""
    cycles: int
    load_pct: float
    latency_mean_ms: float
    """From the sample (with SYNC: from its end) to the last contact TPDO."""
    latency_max_ms: float
    touch_mean_ms: float
    """From a touch, which comes at any time before the sample, to the last contact TPDO."""
    touch_max_ms: float
    bound_ms: float
    """On the latency, by ``skinbus plan``; 0 where nothing bounds it."""
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


def measure_end_to_end(
    n_patches: int,
    eds: str,
    *,
    rate_hz: float | None = None,
    level: str = DEFAULT_LEVEL,
    cycles: int = 50,
) -> EndToEndRow:
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
    wire = VirtualBus(arm.bus.bitrate)
    world = World(scene)
    wire.attach(world)
    wire.attach(master)

    period_ns = round(1e9 / rate_hz)
    now_ns = _run_until_all_send(wire, reports, n_patches, period_ns)
    del reports[:]
    latencies = _watch_latency(wire)
    wire.run(now_ns + cycles * period_ns)

    for report in reports:
        c = report.contacts
        score.add(_points(world.truth(report.t_ns)), Points(report.ids, c.link, c.s, c.a, c.force))
    messages = traffic(ods_of(arm), rate_hz=rate_hz, beside=Beside(contacts=n_touches)).messages
    bounds = cycle_times(messages, arm.bus.bitrate)
    known = [bounds[m.cob_id] for m in messages if m.name.startswith("contact")]
    bound_ns = max((t for t in known if t is not None), default=0)
    return _row(eds, "sync", arm, len(reports), wire, latencies, bound_ns, score)


def measure_on_change(n_patches: int, eds: str, *, rate_hz: float = 100.0, cycles: int = 50) -> EndToEndRow:
    """Return what a bus does whose patches sample by themselves and send what has changed."""
    arm = arm_of(n_patches, eds, rate_hz)
    scene = _scene(arm, min(_TOUCHES, n_patches))
    score = Score(arm)
    wire = VirtualBus(arm.bus.bitrate)
    world = World(scene, follows="clock")
    send_on_change(world, arm)
    listener = OnChange(arm, "fit", start_ns=_ALL_BOOTED_NS)
    wire.attach(world)
    wire.attach(listener)
    period_ns = round(1e9 / rate_hz)
    begin_ns = _ALL_BOOTED_NS + 5 * period_ns  # after the burst in which everything is news
    samples: list[tuple[int, int]] = []
    _watch_samples(wire, arm, period_ns, begin_ns, samples)
    wire.run(begin_ns + cycles * period_ns)
    answers = [(t_ns, contacts) for t_ns, contacts in listener.answers if t_ns >= begin_ns]
    for t_ns, c in answers:
        ids = np.arange(len(c)) + 1
        score.add(_points(world.truth(t_ns)), Points(ids, c.link, c.s, c.a, c.force))
    latencies = [last - sample for sample, last in samples if last > sample]
    return _row(eds, "change", arm, len(answers), wire, latencies, 0, score)


def _row(
    eds: str,
    mode: str,
    arm: Arm,
    cycles: int,
    wire: VirtualBus,
    latencies: Sequence[int],
    bound_ns: int,
    score: Score,
) -> EndToEndRow:
    mean_ms, max_ms = float(np.mean(latencies)) / 1e6, float(np.max(latencies)) / 1e6
    period_ms = 1e3 / arm.bus.rate_hz
    return EndToEndRow(
        eds=eds,
        mode=mode,
        patches=arm.n_patches,
        rate_hz=arm.bus.rate_hz,
        cycles=cycles,
        load_pct=100.0 * wire.load(),
        latency_mean_ms=mean_ms,
        latency_max_ms=max_ms,
        touch_mean_ms=0.5 * period_ms + mean_ms,
        touch_max_ms=period_ms + max_ms,
        bound_ms=bound_ns / 1e6,
        position_median_mm=score.position_mm()["median"],
        force_median_pct=score.force_pct()["median"],
        missed=score.missed,
    )


def _points(truth: Touches) -> Points:
    return Points(truth.touch, truth.link, truth.s, truth.a, truth.force)


def _watch_samples(
    wire: VirtualBus, arm: Arm, period_ns: int, begin_ns: int, samples: list[tuple[int, int]]
) -> None:
    """Fill a list with the time of each sample that was worth a frame, and of the last contact TPDO after it.

    Samples are taken every ``period_ns`` from power-on at 0 on, all patches at once.
    """
    readings, contacts = ReadingsPlan(arm, ods_of(arm)).cob_ids, set(usual().contact_ids)

    def note(frame: Frame) -> None:
        if frame.t_ns < begin_ns:
            return
        if frame.can_id in readings:
            sample = frame.t_ns // period_ns * period_ns
            if not samples or samples[-1][0] != sample:
                samples.append((sample, 0))
        elif frame.can_id in contacts and samples:
            samples[-1] = samples[-1][0], frame.t_ns

    wire.tap(note)


def _run_until_all_send(wire: VirtualBus, reports: list[CycleReport], n_patches: int, period_ns: int) -> int:
    """Let the patches boot; return the bus time at which a cycle had the readings of all."""
    now_ns = 0
    while not (reports and reports[-1].n_fresh == n_patches):
        now_ns += period_ns
        if now_ns > _BOOT_LIMIT_NS:
            raise SkinbusError(f"{n_patches} patches have not all booted within {_BOOT_LIMIT_NS / 1e9:g} s")
        wire.run(now_ns)
    return now_ns


def _watch_latency(wire: VirtualBus) -> list[int]:
    """Return a list that fills with the time from each SYNC to the last contact TPDO of its cycle, ns."""
    latencies: list[int] = []
    contacts = set(usual().contact_ids)
    sync_ns = last_ns = 0

    def note(frame: Frame) -> None:
        nonlocal sync_ns, last_ns
        if frame.can_id == cia.SYNC_ID:
            if last_ns > sync_ns > 0:
                latencies.append(last_ns - sync_ns)
            sync_ns = frame.t_ns
        elif frame.can_id in contacts:
            last_ns = frame.t_ns

    wire.tap(note)
    return latencies


def _scene(arm: Arm, n_touches: int) -> Scene:
    """Return fingertips that press now more, now less, all over an arm, off the centres of the boards."""
    step = arm.n_patches // n_touches
    touches = []
    for k in range(n_touches):
        placed = arm.patches[k * step]
        path = np.array([[0.0, placed.s + 0.004, placed.a - 0.006]])
        times = np.arange(0.0, _DURATION_S, 0.5 * _PULSE_S)
        keys = np.column_stack([times, np.where(np.arange(len(times)) % 2, *_FORCES)])
        touches.append(Touch(link=0, path=path, force=keys, shape=Shape.DISC, length=0.012))
    return Scene(
        "end to end",
        arm,
        duration_s=_DURATION_S,
        layer=Elastic(),
        touches=touches,
        effects=[Noise(sigma_pa=200.0)],
    )
