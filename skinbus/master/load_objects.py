"""Loads as objects of the master's nodes: of the arm, of patches by node-ID, of links from 1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.estimate import Loads
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import cia, profile
from skinbus.objects.contacts import FORCE_STEP, MAX_LINKS

OF_PATCHES = (profile.PATCH_LOAD, profile.PATCH_LOAD_SD, profile.PATCH_AREA)
OF_LINKS = (
    profile.LINK_LOAD,
    profile.LINK_LOAD_SD,
    profile.LINK_LOAD_S,
    profile.LINK_LOAD_A,
    profile.LINK_LOAD_PLACE_SD,
    profile.LINK_AREA,
)
AREA_STEP = 1e-6
"""m^2 per count of a touched area."""


class LoadObjects:
    """Writes loads into the devices, one for each bus: patches into that of their bus, all else into all."""

    def __init__(self, arm: Arm, devices: Sequence[Device], od: ObjectDictionary) -> None:
        self._of_arm = [device.values.rows(od[profile.LOAD.object].index, 1) for device in devices]
        self._patches = [arm.patches_on(k) for k in range(len(devices))]
        self._rows = [arm.node_id[patches] - 1 for patches in self._patches]
        self._of_patches, self._of_links = (
            [[device.image_view(od[name.object].index, 1, most) for name in names] for device in devices]
            for names, most in ((OF_PATCHES, cia.MAX_NODE_ID), (OF_LINKS, MAX_LINKS))
        )
        self._n_links = min(len(arm.links), MAX_LINKS)
        self._written: Loads | None = None

    def write(self, loads: Loads) -> None:
        """Write the loads of a cycle; those of a skin that nothing touches are written once."""
        if loads is self._written:
            return
        self._written = loads
        patches, links, n = loads.patches, loads.links, self._n_links
        place_sd = np.where(np.isfinite(links.place_sd), links.place_sd, 0.0)
        of_links = (links.force, links.force_sd, links.s, links.a, place_sd, links.area)
        for part, rows, views, more in zip(
            self._patches, self._rows, self._of_patches, self._of_links, strict=True
        ):
            for view, column in zip(views, (patches.force, patches.force_sd, patches.area), strict=True):
                view[rows] = column[part]
            for view, column in zip(more, of_links, strict=True):
                view[:n] = column[:n]
        for record in self._of_arm:
            row = record[0]
            row["Force"], row["Force sd"] = loads.force, loads.force_sd
            row["Touched area"], row["Touched area sd"] = loads.area, loads.area_sd
            row["Force 0.01N"] = _counts(loads.force, FORCE_STEP, 0xFFFFFFFF)
            row["Force sd 0.01N"] = _counts(loads.force_sd, FORCE_STEP, 0xFFFF)
            row["Touched area mm2"] = _counts(loads.area, AREA_STEP, 0xFFFF)

    def clear(self) -> None:
        """Write no load."""
        self._written = None
        for rows, views, more in zip(self._rows, self._of_patches, self._of_links, strict=True):
            for view in views:
                view[rows] = 0.0
            for view in more:
                view[: self._n_links] = 0.0
        for record in self._of_arm:
            record[...] = np.zeros((), record.dtype)


def _counts(value: float, step: float, most: int) -> int:
    """Return a value in counts, saturating at 0 and ``most``."""
    return round(min(max(value / step, 0.0), most))
