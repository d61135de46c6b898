"""The arm: links with surfaces, patches placed on them, compiled once to flat read-only arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Floats
from skinbus.model.bend import COLUMNS, bent
from skinbus.model.guard import GuardSettings
from skinbus.model.law import DEFAULT_LAW, Law
from skinbus.model.limits import MOST_LENGTH, check_numbers
from skinbus.model.patch import Patch
from skinbus.model.robot import RobotSettings
from skinbus.model.surface import Surface


@dataclass(frozen=True, slots=True, kw_only=True)
class BusSettings:
    """What the arm file says of a bus."""

    bitrate: int = 1_000_000
    data_bitrate: int | None = None
    """Of the data phase of CAN FD; None on a bus of classic CAN."""
    rate_hz: float = 50.0
    """SYNC rate, the same on all buses of an arm: one cycle goes over all."""
    sdo_timeout_ms: int = 300
    """How long an answer of a patch is awaited."""
    store_timeout_ms: int = 5000
    """The same of a store or restore command (0x1010, 0x1011): flash takes up to two seconds."""
    name: str = ""
    """Empty where there is one bus and the file does not name it."""
    interface: str | None = None
    channel: str | None = None
    """Where the bus is unless the user says otherwise."""
    sync_counter: int = 0
    """Value after which the counter of SYNC starts again at 1 (0x1019); 0: SYNC carries none."""
    max_age_ms: int = 100
    """Oldest sample that is used: two periods of the slowest skins, so that one lost frame costs nothing."""


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid part of the arm with one surface."""

    name: str
    surface: Surface


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedPatch:
    """A patch on a link: its centre at (s, a), turned by yaw; at yaw 0 u points along s and v along a."""

    patch: Patch
    node_id: int
    link: int
    s: float
    a: float
    yaw: float = 0.0
    eds: str = "skin-patch"
    """Name or path of the EDS or DCF that describes the board."""
    settings: tuple[tuple[str, Any], ...] = ()
    """Objects to set on top of it, by name or index."""
    serial: int = 0
    """Serial number of the board that belongs here; 0 for any."""
    bus: int = 0
    """Number of the bus it is on, from 0."""
    address: str | None = None
    """Where its readings come from, if a gateway takes them from another skin."""
    key: str = ""
    """Where the arm file says so, for messages."""
    on_chart: Floats | None = None
    """(n_tactels, 12) of its tactels on the chart of a mesh: s, a (m), scale, and ``model.bend``; None on
    other surfaces, to which boards are bent without stretching."""

    @property
    def scale(self) -> float:
        """Length on the chart of the link per length on the board: 1 but on a mesh that stretches."""
        return 1.0 if self.on_chart is None else float(self.on_chart[:, 2].mean())

    def developed(self, uv: Floats) -> Floats:
        """Return places (n, 2) m of the board on the surface developed about its centre, (n, 2) m."""
        u, v = uv.T
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.stack([self.s + cos * u - sin * v, sin * u + cos * v], -1)

    def on_link(self, surface: Surface, uv: Floats) -> tuple[Floats, Floats]:
        """Return places (n, 2) m of the board, bent to its link, in chart coordinates s, a (n,) m."""
        x, y = self.developed(uv).T
        return surface.undevelop(x, y, self.a)


class Arm:
    """All patches of an arm as flat columns; tactels are numbered patch after patch.

    Patches come bus after bus; a node-ID names one patch of a bus.

    Per bus:    bus_start (n_buses + 1,)
    Per patch:  node_id, patch_bus, patch_link, patch_s, patch_a (n_patches,); patch_start (n_patches + 1,)
    Per tactel: tactel_patch, tactel_link (n_tactels,); tactel_s, tactel_a (n_tactels,) m;
                tactel_offset in counts; tactel_gain; tactel_healthy; tactel_width, by the scale of the chart
                as well; tactel_bend (n_tactels, 9), ``model.bend``, or (0, 9) where no chart stretches;
                tactel_bias in Pa;
                tactel_noise, tactel_threshold, tactel_release, tactel_zero_band,
                tactel_zero_drift (n_tactels,) Pa
    Per link:   link_shapes (n_links, 4): radius, taper, period and length; see ``model.surface``
    """

    def __init__(
        self,
        name: str,
        links: Sequence[Link],
        patches: Sequence[PlacedPatch],
        *buses: BusSettings,
        robot: RobotSettings | None = None,
        guard: GuardSettings | None = None,
    ) -> None:
        """``buses``: one with the usual settings if none is given; ``robot``: what carries the skin, if said.

        ``guard``: its limits, if it has any.

        Raises:
            ValueError: there is no link or no patch, the patches do not come bus after bus, the buses have
                several rates, two patches of a bus share a node-ID, or a patch is on no link or at no place.
        """
        if not links or not patches:
            raise ValueError("an arm has at least one link and one patch")
        self.name = name
        self.links = tuple(links)
        self.patches = tuple(patches)
        self.buses = buses or (BusSettings(),)
        self.robot = robot
        self.guard = guard
        if len({settings.rate_hz for settings in self.buses}) > 1:
            raise ValueError("one cycle goes over all buses: they have one rate")
        numbers = [placed.bus for placed in patches]
        if numbers != sorted(numbers) or not 0 <= numbers[0] <= numbers[-1] < len(self.buses):
            raise ValueError(f"patches on buses {numbers}; wanted bus after bus, of {len(self.buses)}")

        for placed in patches:
            if not 0 <= placed.link < len(links):
                raise ValueError(f"a patch on link {placed.link}; wanted 0 to {len(links) - 1}")
            check_numbers("place and yaw", (placed.s, placed.a, placed.yaw), (-MOST_LENGTH, MOST_LENGTH))

        self._patch_at = {(placed.bus, placed.node_id): p for p, placed in enumerate(patches)}
        if len(self._patch_at) < len(patches):
            raise ValueError("two patches of a bus share a node-ID")
        counts = [placed.patch.n_tactels for placed in patches]
        self.link_shapes = _read_only([link.surface.shape for link in links])
        self.node_id = _read_only([placed.node_id for placed in patches], np.int32)
        self.patch_bus = _read_only(numbers, np.uint8)
        self.bus_start = _read_only(np.searchsorted(numbers, np.arange(len(self.buses) + 1)), np.int32)
        self.patch_link = _read_only([placed.link for placed in patches], np.int32)
        self.patch_s = _read_only([placed.s for placed in patches])
        self.patch_a = _read_only([placed.a for placed in patches])
        self.patch_start = _read_only([0, *np.cumsum(counts)], np.int32)

        self.tactel_patch = _read_only(np.repeat(np.arange(len(patches)), counts), np.int32)
        self.tactel_link = _read_only(self.patch_link[self.tactel_patch], np.int32)
        chart = np.concatenate([_chart(self.links[p.link].surface, p) for p in patches])
        self.tactel_s, self.tactel_a = map(_read_only, chart[:, :2].T)
        self.tactel_bend = _read_only(chart[:, 3:] if chart[:, 3:].any() else chart[:0, 3:])

        def column(name: str, thresholds: float = 0.0) -> Floats:
            """Return what patches or their tactels have, or so many thresholds, as one column."""
            own = [(p.patch, getattr(p.patch, name)) for p in patches]
            usual = [(p, thresholds * p.threshold if value is None else value) for p, value in own]
            return _read_only(np.concatenate([np.broadcast_to(value, p.n_tactels) for p, value in usual]))

        self.tactel_gain, self.tactel_offset, self.tactel_bias = map(column, ("gain", "offset", "bias"))
        self.tactel_width = _read_only(column("width") * chart[:, 2])
        self.tactel_noise, self.tactel_healthy = column("noise"), _read_only(column("healthy"), np.bool_)
        self.tactel_threshold, self.tactel_release = column("threshold"), column("release")
        self.tactel_zero_band = column("zero_band", 2.5)
        self.tactel_zero_drift = column("zero_drift", 0.3)

    @classmethod
    def single_patch(cls, tactels_uv: npt.ArrayLike, *, law: Law | None = None, **settings: Any) -> Self:
        """Return an arm of one flat patch with tactels at (n_tactels, 2) m; s = u and a = v.

        ``settings`` go to :class:`Patch`: diameter, transducer, threshold, gain, noise, healthy, size.
        """
        uv = check_numbers("tactels_uv", tactels_uv, (-MOST_LENGTH, MOST_LENGTH)).copy()
        if uv.ndim != 2 or uv.shape[1] != 2 or not len(uv):
            raise ValueError(f"tactels_uv must be of shape (n, 2), n >= 1; got shape {uv.shape}")
        extent = 2.0 * np.abs(uv).max(axis=0) + 10e-3
        settings.setdefault("size", (float(extent[0]), float(extent[1])))
        patch = Patch(tactels_uv=uv, law=law or DEFAULT_LAW, **settings)
        link = Link("pad", Surface.plane(*patch.size))
        placed = PlacedPatch(patch=patch, node_id=1, link=0, s=0.0, a=0.0)
        return cls("single patch", [link], [placed])

    def __repr__(self) -> str:
        return f"<Arm {self.name}: n_patches={self.n_patches}, n_tactels={self.n_tactels}>"

    @property
    def n_patches(self) -> int:
        """Number of patches."""
        return len(self.patches)

    @property
    def n_tactels(self) -> int:
        """Number of tactels of all patches."""
        return len(self.tactel_patch)

    @property
    def bus(self) -> BusSettings:
        """The first bus, of most arms the only one."""
        return self.buses[0]

    @property
    def guarded(self) -> Bools:
        """Which patches have limits, (n_patches,): those with a healthy tactel in a region."""
        tactels = self.tactel_healthy & (self.guard.tactels if self.guard else False)
        return np.logical_or.reduceat(tactels, self.patch_start[:-1])

    def patch_at(self, node_id: int, bus: int = 0) -> int:
        """Return the patch with a node-ID on a bus; KeyError when there is none."""
        return self._patch_at[bus, node_id]

    def patches_named(self, node_id: int) -> list[int]:
        """Return the patches with a node-ID, on whatever bus."""
        return np.flatnonzero(self.node_id == node_id).tolist()

    def patches_on(self, bus: int) -> slice:
        """Return the range of patches on a bus."""
        return slice(int(self.bus_start[bus]), int(self.bus_start[bus + 1]))

    def part(self, bus: int) -> Arm:
        """Return the arm as far as it is on one bus, as an arm with one bus."""
        patches = [replace(placed, bus=0) for placed in self.patches[self.patches_on(bus)]]
        guard = self.guard and self.guard.part(self.patch_bus[self.tactel_patch] == bus)
        return Arm(self.name, self.links, patches, self.buses[bus], guard=guard)

    def tactels_of(self, patch: int) -> slice:
        """Return the range of tactel numbers of a patch."""
        return slice(int(self.patch_start[patch]), int(self.patch_start[patch + 1]))

    def distance(self, tactels: Any, s: npt.ArrayLike, a: npt.ArrayLike) -> Floats:
        """Return how far tactels of one link are from places, (n, n_tactels) m along the surface.

        tactels: an index of tactels; s, a (n,) m
        """
        link = int(np.atleast_1d(self.tactel_link[tactels])[0])
        surface, own_s, own_a = self.links[link].surface, self.tactel_s[tactels], self.tactel_a[tactels]
        s, a = np.asarray(s, np.float64)[..., None], np.asarray(a, np.float64)[..., None]
        distance = surface.distance(s, a, own_s, own_a)
        if len(self.tactel_bend):
            distance = distance * bent(self.tactel_bend[tactels], s - own_s, surface.wrap(a - own_a))
        return np.asarray(distance)

    def on_board(self, patch: int, s: npt.ArrayLike, a: npt.ArrayLike) -> Floats:
        """Return chart coordinates s, a (n,) m of the link of a patch in the frame of its board, (n, 2) m."""
        placed = self.patches[patch]
        x, y = self.links[placed.link].surface.develop(s, a, placed.a)
        cos, sin = np.cos(placed.yaw), np.sin(placed.yaw)
        return np.stack([cos * (x - placed.s) + sin * y, cos * y - sin * (x - placed.s)], -1)

    def on_link(self, patch: int, uv: Floats) -> tuple[Floats, Floats]:
        """Return places (n, 2) m in the frame of a board as chart coordinates s, a (n,) m of its link."""
        placed = self.patches[patch]
        return placed.on_link(self.links[placed.link].surface, uv)

    def node_label(self, patch: int) -> str:
        """Return the node-ID of a patch, behind the name of its bus where there are several."""
        placed = self.patches[patch]
        bus = f"{self.buses[placed.bus].name} " if len(self.buses) > 1 else ""
        return f"{bus}{placed.node_id}"

    def with_law(self, law: Law) -> Arm:
        """Return the same arm with another contact law on every patch."""
        return self._with([replace(p, patch=replace(p.patch, law=law)) for p in self.patches], self.buses)

    def with_rate(self, rate_hz: float) -> Arm:
        """Return the same arm with another SYNC rate."""
        return self._with(self.patches, [replace(settings, rate_hz=rate_hz) for settings in self.buses])

    def _with(self, patches: Sequence[PlacedPatch], buses: Sequence[BusSettings]) -> Arm:
        return Arm(self.name, self.links, patches, *buses, robot=self.robot, guard=self.guard)


def _chart(surface: Surface, placed: PlacedPatch) -> Floats:
    """Return the tactels of a placed patch on its link as ``on_chart`` has them, (n_tactels, 12)."""
    if placed.on_chart is not None:
        return placed.on_chart
    places = np.stack(placed.on_link(surface, placed.patch.tactels_uv), -1)
    return np.pad(np.pad(places, ((0, 0), (0, 1)), constant_values=1.0), ((0, 0), (0, COLUMNS)))


def _read_only(values: npt.ArrayLike, dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    array = np.array(values, dtype, order="C")
    array.setflags(write=False)
    return array
