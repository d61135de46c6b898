"""What of an arm does not change from cycle to cycle, and a digest that distinguishes arms by it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats, Ints32
from skinbus.errors import ArgumentError
from skinbus.model import Arm

_STEP = 1e-6
"""m to which places are compared: far below what is felt, far above what libraries round differently."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinLayout:
    """What does not change: links and patches of an arm."""

    name: str
    links: tuple[str, ...]
    buses: tuple[str, ...]
    node_id: Ints32
    """(n_patches,)"""
    patch_bus: Ints32
    """(n_patches,) numbers of buses."""
    patch_link: Ints32
    """(n_patches,) numbers of links."""
    patch_tactels: Ints32
    """(n_patches,) numbers of tactels."""
    period_ns: int
    X_LS: Floats | None = None
    """(n_links, 4, 4) poses of surfaces in the URDF's links; None where they are not known."""
    joints: tuple[str, ...] | None = None
    """Names of the joints that move skin or tool; None without ``[robot]``, or where they are not known."""
    geometry: int = 0
    """Digest of names, and of where links, boards and tactels are: of what a contact and a reading mean."""

    @classmethod
    def of(cls, arm: Arm) -> SkinLayout:
        """Return that of an arm."""
        X_LS = np.broadcast_to(np.eye(4), (len(arm.links), 4, 4))
        joints = None
        if arm.robot is not None:
            from skinbus.robot.chain import load_chain  # nobody else pays for it

            X_LS = np.array([frame.X_LS for frame in arm.robot.links])
            joints = load_chain(arm.robot).names
        return cls(
            arm.name,
            tuple(link.name for link in arm.links),
            tuple(bus.name for bus in arm.buses),
            arm.node_id,
            arm.patch_bus.astype(np.int32),
            arm.patch_link,
            np.diff(arm.patch_start).astype(np.int32),
            round(1e9 / arm.bus.rate_hz),
            X_LS,
            joints,
            digest(arm),
        )

    @property
    def n_tactels(self) -> int:
        """Of all patches."""
        return int(self.patch_tactels.sum())

    def patch_at(self, node_id: int, bus: str | None = None) -> int:
        """Return the index of the patch with a node-ID, on a bus where several have that node-ID.

        Raises:
            ArgumentError: there is none, or there are several.
        """
        alike = np.flatnonzero(self.node_id == node_id).tolist()
        buses = {k: self.buses[self.patch_bus[k]] for k in alike}
        found = [k for k in alike if bus in (None, buses[k])]
        if len(found) == 1:
            return int(found[0])
        what = f"{'several patches have' if found else 'no patch has'} node-ID {node_id!r}"
        there = f": it is on buses {', '.join(buses.values())}" if any(buses.values()) else ""
        raise ArgumentError(f"{what}{'' if bus is None else f' on bus {bus!r}'}{there}")

    def tactels_of(self, patch: int) -> slice:
        """Return the tactels of a patch by its index."""
        end = int(self.patch_tactels[: patch + 1].sum())
        return slice(end - int(self.patch_tactels[patch]), end)


def digest(arm: Arm) -> int:
    """Return a number of 64 bits for names, and where links, boards and tactels are; never 0."""
    parts: list[npt.ArrayLike] = [arm.node_id, arm.patch_bus, arm.patch_link, arm.patch_s, arm.patch_a]
    parts += [arm.patch_start, arm.tactel_s, arm.tactel_a]
    for surface in (link.surface for link in arm.links):
        parts.append([surface.length, surface.radius, surface.period, surface.width, surface.taper])
        parts += [getattr(surface, "points", ()), getattr(surface, "triangles", ())]
    steps = [np.nan_to_num(np.round(np.asarray(part, np.float64) / _STEP)) for part in parts]
    data = b"|".join((step + 0.0).tobytes() for step in steps)  # + 0.0: minus zero is zero
    names = repr([*(link.name for link in arm.links), *(bus.name for bus in arm.buses)]).encode()
    return int.from_bytes(hashlib.sha256(data + names).digest()[:8], "little") or 1
