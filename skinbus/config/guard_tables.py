"""The tables of an arm file that describe the guard: ``[guard]`` and ``[[guard.region]]``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from skinbus.arrays import Bools
from skinbus.config.arm_tables import Name, NodeId, Place, Positive, Table, Text
from skinbus.errors import FaultList
from skinbus.model.arm import Arm
from skinbus.model.guard import GuardRegion, GuardSettings
from skinbus.objects.guard import MAX_SAMPLES


def _check_order(value: list[float]) -> list[float]:
    if value[1] < value[0]:
        raise ValueError("two numbers, the second not less than the first")
    return value


Pair = Field(min_length=2, max_length=2), AfterValidator(_check_order)
Range = Annotated[list[Place], *Pair]
Samples = Annotated[list[Annotated[int, Field(ge=1, le=MAX_SAMPLES)]], *Pair]
Time = Annotated[float, Field(ge=0.0, le=60_000.0)]
"""ms."""

EDGE = 1e-6
"""mm and degrees, by which a range is wider than it is written: sums of places are off by bits."""


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
    liveness_ms: Annotated[int, Field(ge=2, le=1000)] = 50
    """Two periods without it are a stop: a second is longer than anybody waits for one."""
    samples: Samples = Field(default=[1, 1])
    transient_ms: Time = 500.0
    reaction_ms: Time = 0.0
    stop_ms: Time = 0.0

    @property
    def regions(self) -> list[tuple[str, RegionTable]]:
        """With their keys."""
        return [(f"guard.region[{i}]", region) for i, region in enumerate(self.region, 1)]


def check_regions(table: GuardTable, links: list[Any], node_ids: Sequence[int], faults: FaultList) -> None:
    """Add the faults of what regions name; ``node_ids`` of no patch are those of a file with faults."""
    for key, region in table.regions:
        if region.link not in (None, *links):
            faults.add(f"{key}.link", region.link, f"the name of a link: {', '.join(map(str, links))}")
        strange = [node_id for node_id in region.patches or () if node_id not in node_ids]
        if strange and node_ids:
            faults.add(f"{key}.patches", strange, "node-IDs of patches")
        if region.force_n is None and region.pressure_kpa is None:
            faults.add(key, None, "force_n or pressure_kpa, or both")


def guard_settings(table: GuardTable, arm: Arm, faults: FaultList) -> GuardSettings:
    """Return what the tables say of the guard of an arm; add a fault of each limit that never trips."""
    boards = [
        (p.patch.transducer.full_scale, math.prod(p.patch.size) / p.patch.n_tactels) for p in arm.patches
    ]
    full, area = np.array(boards)[arm.tactel_patch].T
    full = full * arm.tactel_gain
    regions = []
    for key, region in table.regions:
        found = GuardRegion(
            name=region.name,
            tactels=_tactels(region, arm),
            force=region.force_n or math.inf,
            pressure=1e3 * (region.pressure_kpa or math.inf),
            transient_factor=region.transient_factor,
            source=region.source,
        )
        regions.append(found)
        inside = found.tactels & arm.tactel_healthy
        if not inside.any():
            faults.add(key, "no healthy tactel", "tactels in it")
            continue
        if not (arm.tactel_gain[inside] > 0.0).all():
            faults.add(key, "a tactel whose gain is not positive", "readings that rise with pressure")
            continue
        forces = np.bincount(arm.tactel_patch[inside], (area * full)[inside])
        least = {"force_n": forces[forces != 0.0].min(), "pressure_kpa": 1e-3 * full[inside].min()}
        for name, most in least.items():
            limit, most = getattr(region, name), most / region.transient_factor
            if limit and limit > most:
                faults.add(f"{key}.{name}", limit, f"at most {most:.5g}: full scale over transient_factor")
    times = ("liveness", "transient", "reaction", "stop")
    in_ns = {f"{name}_ns": round(1e6 * getattr(table, f"{name}_ms")) for name in times}
    return GuardSettings(regions=tuple(regions), n=table.samples[0], m=table.samples[1], **in_ns)


def _tactels(region: RegionTable, arm: Arm) -> Bools:
    """Return which tactels are in a region, (n_tactels,)."""
    inside = np.isin(arm.node_id, region.patches or arm.node_id)[arm.tactel_patch]
    if region.link:
        inside &= arm.tactel_link == [link.name for link in arm.links].index(region.link)
    radius, _, period, _ = arm.link_shapes[arm.tactel_link].T
    angle = np.degrees(arm.tactel_a / np.where(period > 0.0, radius, np.nan))  # there is none on a plane
    for limits, place, turn in (
        (region.s_mm, 1e3 * arm.tactel_s, math.inf),
        (region.a_mm, 1e3 * arm.tactel_a, math.inf),
        (region.angle_deg, angle, 360.0),
    ):
        if limits:
            inside &= (place - limits[0] + EDGE) % turn <= limits[1] - limits[0] + 2 * EDGE
    return np.asarray(inside)
