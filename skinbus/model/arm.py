"""The arm: links with surfaces, patches placed on them, compiled once to flat read-only arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from skinbus.model.law import Cone, Law
from skinbus.model.patch import Patch
from skinbus.model.surface import Surface

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True, kw_only=True)
class BusSettings:
    """What the arm file says of its bus."""

    bitrate: int = 1_000_000
    rate_hz: float = 50.0


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


class Arm:
    """All patches of an arm as flat columns; tactels are numbered patch after patch.

    Per patch:  node_id, patch_link, patch_s, patch_a (n_patches,); patch_start (n_patches + 1,)
    Per tactel: tactel_patch, tactel_link (n_tactels,); tactel_s, tactel_a (n_tactels,) m;
                tactel_offset in counts; tactel_gain; tactel_healthy;
                tactel_noise, tactel_threshold, tactel_release (n_tactels,) Pa
    Per link:   link_radius, link_taper, link_period, link_length (n_links,); see ``model.surface``
    """

    def __init__(
        self,
        name: str,
        links: Sequence[Link],
        patches: Sequence[PlacedPatch],
        bus: BusSettings | None = None,
    ) -> None:
        if not links or not patches:
            raise ValueError("an arm has at least one link and one patch")
        self.name = name
        self.links = tuple(links)
        self.patches = tuple(patches)
        self.bus = bus or BusSettings()

        self.link_radius = _column(link.surface.radius for link in links)
        self.link_taper = _column(link.surface.taper for link in links)
        self.link_period = _column(link.surface.period for link in links)
        self.link_length = _column(link.surface.length for link in links)

        counts = [placed.patch.n_tactels for placed in patches]
        self.node_id = _read_only(np.array([placed.node_id for placed in patches], np.int32))
        self.patch_link = _read_only(np.array([placed.link for placed in patches], np.int32))
        self.patch_s = _column(placed.s for placed in patches)
        self.patch_a = _column(placed.a for placed in patches)
        self.patch_start = _read_only(np.concatenate([[0], np.cumsum(counts)]).astype(np.int32))

        self.tactel_patch = _read_only(np.repeat(np.arange(len(patches), dtype=np.int32), counts))
        self.tactel_link = _read_only(self.patch_link[self.tactel_patch])
        chart = np.concatenate([_chart(self.links[p.link].surface, p) for p in patches])
        self.tactel_s = _read_only(np.ascontiguousarray(chart[:, 0]))
        self.tactel_a = _read_only(np.ascontiguousarray(chart[:, 1]))
        self.tactel_gain = _spread([1.0 if p.patch.gain is None else p.patch.gain for p in patches], counts)
        self.tactel_offset = _spread(
            [0.0 if p.patch.offset is None else p.patch.offset for p in patches], counts
        )
        self.tactel_noise = _spread([p.patch.noise for p in patches], counts)
        self.tactel_threshold = _spread([p.patch.threshold for p in patches], counts)
        self.tactel_release = _spread([p.patch.release for p in patches], counts)
        healthy = [1.0 if p.patch.healthy is None else p.patch.healthy for p in patches]
        self.tactel_healthy = _read_only(_spread(healthy, counts) > 0.0)

    @classmethod
    def single_patch(cls, tactels_uv: npt.ArrayLike, *, law: Law | None = None, **settings: Any) -> Self:
        """Return an arm of one flat patch with tactels at (n_tactels, 2) m; s = u and a = v.

        ``settings`` go to :class:`Patch`: diameter, transducer, threshold, gain, noise, healthy, size.
        """
        uv = np.array(tactels_uv, np.float64)
        if uv.ndim != 2 or uv.shape[1] != 2 or not len(uv) or not np.isfinite(uv).all():
            raise ValueError(f"tactels_uv must be finite and of shape (n, 2), n >= 1; got shape {uv.shape}")
        extent = 2.0 * np.abs(uv).max(axis=0) + 10e-3
        settings.setdefault("size", (float(extent[0]), float(extent[1])))
        patch = Patch(tactels_uv=uv, law=law or Cone(), **settings)
        link = Link("pad", Surface.plane(*patch.size))
        placed = PlacedPatch(patch=patch, node_id=1, link=0, s=0.0, a=0.0)
        return cls("single patch", [link], [placed])

    @property
    def n_patches(self) -> int:
        """Number of patches."""
        return len(self.patches)

    @property
    def n_tactels(self) -> int:
        """Number of tactels of all patches."""
        return len(self.tactel_patch)

    @cached_property
    def patch_by_node(self) -> dict[int, int]:
        """Index of the patch with a node-ID."""
        return {int(node_id): p for p, node_id in enumerate(self.node_id)}

    def tactels_of(self, patch: int) -> slice:
        """Return the range of tactel numbers of a patch."""
        return slice(int(self.patch_start[patch]), int(self.patch_start[patch + 1]))

    def with_law(self, law: Law) -> Arm:
        """Return the same arm with another contact law on every patch."""
        patches = [replace(p, patch=replace(p.patch, law=law)) for p in self.patches]
        return Arm(self.name, self.links, patches, self.bus)


def _chart(surface: Surface, placed: PlacedPatch) -> Floats:
    """Return (s, a) of the tactels of a placed patch, (n_tactels, 2) m: the board bent, not stretched."""
    cos, sin = math.cos(placed.yaw), math.sin(placed.yaw)
    u, v = placed.patch.tactels_uv.T
    x, y = placed.s + cos * u - sin * v, sin * u + cos * v
    return np.stack(surface.undevelop(x, y, placed.a), -1)


def _read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    array.setflags(write=False)
    return array


def _column(values: Any) -> Floats:
    return _read_only(np.array(list(values), np.float64))


def _spread(values: Sequence[Any], counts: Sequence[int]) -> Floats:
    """Return per-patch scalars or per-tactel arrays as one column over all tactels."""
    parts = [np.broadcast_to(np.asarray(v, np.float64), n) for v, n in zip(values, counts, strict=True)]
    return _read_only(np.concatenate(parts))
