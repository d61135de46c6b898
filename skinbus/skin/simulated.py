"""A simulated arm in this process: patches of a scene, wires and a master, on a virtual clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from pathlib import Path

from skinbus.can.virtual_buses import VirtualBuses
from skinbus.config.system import ods_of
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.master import CycleReport, Master
from skinbus.sim import Scene, World, load_scene
from skinbus.skin.contact import Level
from skinbus.skin.cycle import Cycle, Touch
from skinbus.skin.master_cycles import CycleMaker, played
from skinbus.skin.opened import check_level, saying_why
from skinbus.skin.skin import Skin

STEP_NS = 500_000
"""The wires go on by so much at a time until a cycle has ended: half the shortest period there is."""

BOOT_LIMIT_NS = 60_000_000_000
"""A scene whose patches have not sent anything by then is over."""


def simulate(
    scene: str | Path | Scene,
    *,
    level: Level = DEFAULT_LEVEL,
    zero: bool = False,
    realtime: bool = False,
) -> Skin:
    """Simulate the patches of a scene and their master, in this process.

    Joints that the scene moves are set as the scene has them. The same scene gives the same cycles; they end
    with the scene. ``skinbus sim`` simulates patches on a bus.

    Args:
        scene: name or TOML file of a scene.
        level: of the estimator, "kmeans", "fit" or "full".
        zero: take what each patch reads first for its zero.
        realtime: let time go on by itself, slower where the machine is too slow; otherwise a cycle is made
            when it is asked for, as fast as possible.

    Raises:
        ConfigError: the scene has faults; FileNotFoundError too where there is none.
        ArgumentError: there is no such level.
    """
    check_level(level)
    loaded = scene if isinstance(scene, Scene) else load_scene(scene)
    arm, motion, new = loaded.arm, loaded.motion, deque[Cycle]()
    maker, world = CycleMaker(arm), World(loaded, ods_of(arm))
    wires = VirtualBuses(
        [bus.bitrate for bus in arm.buses], data_bitrates=[bus.data_bitrate for bus in arm.buses]
    )

    def on_cycle(report: CycleReport) -> None:
        cycle = maker.make(master, report)
        # The patches sampled a little after the SYNC was sent, and well before the next.
        half = round(0.5e9 / arm.bus.rate_hz)
        cycle.truth = _truth(loaded, world.scene_time(report.t_ns + half))
        new.append(cycle)

    def cycles() -> Iterator[Cycle]:
        now_ns = 0
        while world.scene_time(now_ns) < loaded.duration_s and (world.n_samples or now_ns <= BOOT_LIMIT_NS):
            now_ns += STEP_NS
            wires.run(now_ns)
            while new:
                yield new.popleft()

    with saying_why():
        master = Master(arm, level=level, zero_at_start=zero, on_cycle=on_cycle)
    wires.attach(world)
    wires.attach(master)
    if motion is not None and (robot := master.robot) is not None:

        def follow(now_ns: int, t_s: float) -> None:
            here = zip(motion.names, motion.positions(t_s).tolist(), strict=True)
            robot.offer(now_ns, {name: position for name, position in here if name in motion.free})

        world.on_sample = follow
    what = f"scene {scene}" if isinstance(scene, str | Path) else "a scene"
    return played(what, cycles(), maker, master, realtime=realtime)


def _truth(scene: Scene, t_s: float) -> tuple[Touch, ...]:
    """Return the touches at a scene time."""
    touches, links = scene.touches_at(t_s), scene.arm.links
    truth = []
    for k, s, a, force in zip(touches.link.tolist(), touches.s, touches.a, touches.force, strict=True):
        point, normal = links[k].surface.position(s, a)
        truth.append(Touch(links[k].name, float(s), float(a), point, normal, float(force)))
    return tuple(truth)
