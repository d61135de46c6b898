"""The tables of an arm file that describe the guard: ``[guard]`` and ``[[guard.region]]``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from skinbus.arrays import Bools, Floats
from skinbus.config.arm_tables import Name, NodeId, Place, Positive, Table, Text
from skinbus.config.placement import Named
from skinbus.errors import FaultList
from skinbus.model.arm import Arm
from skinbus.model.guard import GuardRegion, GuardSettings
from skinbus.objects.guard import MAX_SAMPLES


def _check_range(value: list[float]) -> list[float]:
    if value[1] <= value[0]:
        raise ValueError("[from, to], the second larger")
    return value


def _check_samples(value: list[int]) -> list[int]:
    if not 1 <= value[0] <= value[1] <= MAX_SAMPLES:
        raise ValueError(f"[n, m], 1 <= n <= m <= {MAX_SAMPLES}")
    return value


Range = Annotated[list[Place], Field(min_length=2, max_length=2), AfterValidator(_check_range)]
Samples = Annotated[list[int], Field(min_length=2, max_length=2), AfterValidator(_check_samples)]
Time = Annotated[float, Field(ge=0.0, le=60_000.0)]
"""ms."""


class RegionTable(Table):
    """``[[guard.region]]``: the tactels that are in all that is said, with their limits."""

    name: Name
    link: Name | None = None
    s_mm: Range | None = None
    angle_deg: Range | None = None
    a_mm: Range | None = None
    patches: Annotated[list[NodeId], Field(min_length=1)] | None = None
    force_n: Positive | None = None
    pressure_kpa: Positive | None = None
    transient_factor: Annotated[float, Field(ge=1.0, le=100.0)] = 1.0
    source: Text


class GuardTable(Table):
    """``[guard]``: how patches compare, and what is assumed of the stop."""

    region: Annotated[list[RegionTable], Field(min_length=1)]
    liveness_ms: Annotated[int, Field(ge=2, le=1000)] = 20
    """Two periods without it are a stop: a second is longer than anybody waits for one."""
    samples: Samples = Field(default=[1, 1])
    transient_ms: Time = 500.0
    reaction_ms: Time = 0.0
    stop_ms: Time = 0.0


def regions_of(table: GuardTable) -> list[tuple[str, RegionTable]]:
    """Return the regions with their keys."""
    return [(f"guard.region[{i}]", region) for i, region in enumerate(table.region, 1)]


def check_regions(
    table: GuardTable, named: Named, known: Sequence[Any], node_ids: Sequence[int], faults: FaultList
) -> None:
    """Add the faults of what regions name.

    known:    names of all links, of those with faults too
    node_ids: of all patches; none where some have faults
    """
    for key, region in regions_of(table):
        _, link = named.get(region.link or "", (0, None))
        if region.link is not None and region.link not in known:
            faults.add(f"{key}.link", region.link, f"the name of a link: {', '.join(map(str, known))}")
        around = "angle_deg" if link and "angle_deg" in link.places else "a_mm"
        for name in ("s_mm", "angle_deg", "a_mm"):
            if (seen := getattr(region, name)) is not None:
                if region.link is None:
                    faults.add(f"{key}.{name}", seen, "a link beside it")
                elif link and name not in ("s_mm", around):
                    faults.add(f"{key}.{name}", seen, f"no such key on a {link.kind}, which has {around}")
        for k, node_id in enumerate(region.patches or ()):
            if node_ids and node_id not in node_ids:
                faults.add(f"{key}.patches[{k + 1}]", node_id, "the node-ID of a patch")
        if region.force_n is None and region.pressure_kpa is None:
            faults.add(key, None, "force_n or pressure_kpa, or both")


def guard_settings(table: GuardTable, arm: Arm, faults: FaultList) -> GuardSettings:
    """Return what the tables say of the guard of an arm; add a fault of each limit that never trips."""
    regions = []
    for key, region in regions_of(table):
        tactels = _tactels(region, arm)
        if not (tactels & arm.tactel_healthy).any():
            faults.add(key, "no tactel that is healthy", "tactels in it")
        factor = region.transient_factor
        found = GuardRegion(
            name=region.name,
            tactels=tactels,
            force=region.force_n or math.inf,
            pressure=1e3 * (region.pressure_kpa or math.inf),
            transient_factor=factor,
            source=region.source,
        )
        regions.append(found)
        for p in np.unique(arm.tactel_patch[tactels & arm.tactel_healthy]).tolist():
            patch, here = arm.patches[p].patch, arm.tactels_of(p)
            inside = tactels[here] & arm.tactel_healthy[here]
            top = patch.transducer.clipped_counts - arm.tactel_offset[here]
            full = (top * patch.transducer.step * arm.tactel_gain[here])[inside]
            area = math.prod(patch.size) / patch.n_tactels
            for name, limit, most in (
                ("force_n", found.force, float(full.sum()) * area),
                ("pressure_kpa", 1e-3 * found.pressure, 1e-3 * float(full.min())),
            ):
                if factor * limit > most and math.isfinite(limit):
                    scale = f"what patch {arm.node_label(p)} can state"
                    by = f" by transient_factor = {factor:g}" * (factor > 1.0)
                    faults.add(
                        f"{key}.{name}",
                        limit,
                        f"at most {math.floor(100 * most / factor) / 100:g}, {scale}{by}",
                    )
    return GuardSettings(
        regions=tuple(regions),
        n=table.samples[0],
        m=table.samples[1],
        liveness_ns=1_000_000 * table.liveness_ms,
        transient_ns=round(1e6 * table.transient_ms),
        reaction_ns=round(1e6 * table.reaction_ms),
        stop_ns=round(1e6 * table.stop_ms),
    )


def _tactels(region: RegionTable, arm: Arm) -> Bools:
    """Return which tactels are in a region, (n_tactels,)."""
    inside = np.ones(arm.n_tactels, np.bool_)
    if region.patches is not None:
        inside &= np.isin(arm.node_id[arm.tactel_patch], region.patches)
    for k, link in enumerate(arm.links):
        if region.link == link.name:
            inside &= arm.tactel_link == k
            if region.s_mm:
                inside &= _between(1e3 * arm.tactel_s, region.s_mm)
            if region.a_mm:
                inside &= _between(1e3 * arm.tactel_a, region.a_mm)
            if region.angle_deg:
                begin, end = region.angle_deg
                angle = np.degrees(arm.tactel_a / link.surface.radius)
                inside &= (angle - begin) % 360.0 <= end - begin
    return inside


def _between(place: Floats, limits: list[float]) -> Bools:
    return (place >= limits[0]) & (place <= limits[1])
