"""A simulated arm in this process: patches of a scene, wires and a master, on a virtual clock."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Final

from skinbus.can.virtual_buses import VirtualBuses
from skinbus.config.system import ods_of
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.master import CycleReport, Master
from skinbus.sim import Scene, World, load_scene
from skinbus.skin.compile_ahead import SIMULATED, parts_of
from skinbus.skin.contact import Level
from skinbus.skin.cycle import Cycle, Touch
from skinbus.skin.feed import PullFeed, offer
from skinbus.skin.master_cycles import CycleMaker, played
from skinbus.skin.opened import check_level, compile_kernels
from skinbus.skin.skin import Skin

STEP_NS: Final = 500_000
"""The wires go on by so much at a time until a cycle has ended: half the shortest period there is."""

BOOT_LIMIT_NS: Final = 60_000_000_000
"""A scene whose patches have not sent anything by then is over."""


def simulate(
    scene: str | Path | Scene,
    *,
    level: Level = DEFAULT_LEVEL,
    zero: bool = False,
    realtime: bool = False,
) -> Skin:
    """Simulate the patches of a scene and their master, in this process.

    Joints that the scene moves and that no drive reports are set as the scene has them, until the program
    sets some itself. The same scene gives the same cycles; they end with the scene. ``skinbus sim`` simulates
    patches on a bus.

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
    maker = CycleMaker(loaded.arm)
    what = f"scene {scene}" if isinstance(scene, str | Path) else "a scene"
    made = _Simulation(loaded, maker, level, zero)
    feed = PullFeed(maker.layout, what, made.next_cycle, made.master, made.from_scene.clear)
    return played(feed, maker, realtime=realtime)


class _Simulation:
    """Patches and master on wires, moved on until the next cycle has ended."""

    def __init__(self, scene: Scene, maker: CycleMaker, level: str, zero: bool) -> None:
        self._scene = scene
        self._maker = maker
        self._new: deque[Cycle] = deque()
        arm = scene.arm
        compile_kernels(parts_of(level, SIMULATED))
        self.master = Master(arm, level=level, zero_at_start=zero, on_cycle=self._on_cycle)
        self._world = World(scene, ods_of(arm))
        self._wires = VirtualBuses(
            [bus.bitrate for bus in arm.buses], data_bitrates=[bus.data_bitrate for bus in arm.buses]
        )
        self._wires.attach(self._world)
        self._wires.attach(self.master)
        self._now_ns = 0
        self.from_scene: list[str] = []
        """Joints that move as the scene has them, until the program sets some."""
        if scene.motion is not None and self.master.robot is not None:
            settable = self.master.robot.positions.from_python
            self.from_scene = [name for name in scene.motion.moved if name in settable]
            self._world.on_sample = self._follow

    def next_cycle(self) -> Cycle | None:
        """Return the next cycle, None when the scene is over."""
        while not self._new:
            if self._world.scene_time(self._now_ns) >= self._scene.duration_s:
                return None
            if not self._world.n_samples and self._now_ns > BOOT_LIMIT_NS:
                return None
            self._now_ns += STEP_NS
            self._wires.run(self._now_ns)
        return self._new.popleft()

    def _follow(self, now_ns: int, t_s: float) -> None:
        """Take the joint positions of a sample of the scene."""
        if self.from_scene and self._scene.motion is not None:
            motion = self._scene.motion
            positions = motion.positions(t_s)
            offered = {name: float(positions[motion.names.index(name)]) for name in self.from_scene}
            offer(self.master, now_ns, offered)

    def _on_cycle(self, report: CycleReport) -> None:
        cycle = self._maker.make(self.master, report)
        # The patches sampled a little after the SYNC was sent, and well before the next.
        half = round(0.5e9 / self._scene.arm.bus.rate_hz)
        cycle.truth = self._truth(self._world.scene_time(report.t_ns + half))
        cycle.bus_loads = tuple(wire.load() for wire in self._wires.wires)
        self._new.append(cycle)

    def _truth(self, t_s: float) -> tuple[Touch, ...]:
        """Return the touches at a scene time."""
        touches, links = self._scene.touches_at(t_s), self._scene.arm.links
        rows = zip(touches.link.tolist(), touches.s, touches.a, touches.force, strict=True)
        truth = []
        for k, s, a, force in rows:
            point, normal = links[k].surface.position(s, a)
            truth.append(Touch(links[k].name, float(s), float(a), point, normal, float(force)))
        return tuple(truth)
