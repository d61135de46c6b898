"""What an arm file asks of the guard: limits by region, and what is assumed of the stop."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from skinbus.arrays import Bools


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardRegion:
    """A part of the skin with limits of its own."""

    name: str
    tactels: Bools
    """(n_tactels,) of the arm, which are in it."""
    force: float = math.inf
    """N: of a contact that lasts, and of each patch."""
    pressure: float = math.inf
    """Pa: of each tactel."""
    transient_factor: float = 1.0
    """By how much both may be exceeded for ``transient_ns``; patches compare with the product."""
    source: str = ""
    """Where the limits are from, in the user's words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardSettings:
    """The guard of an arm."""

    regions: tuple[GuardRegion, ...]
    n: int = 1
    m: int = 1
    """A patch trips when n of its last m samples are beyond a limit."""
    liveness_ns: int = 50_000_000
    """From one "armed" of a patch to the next; two that are missing are a stop. Those of 24 patches take
    4 % of a bus at 1 Mbit/s."""
    transient_ns: int = 500_000_000
    """How long a contact or pressure may be beyond a limit, but not beyond it times the transient factor."""
    reaction_ns: int = 0
    """Assumed of the process or the relay, from GFC to its output."""
    stop_ns: int = 0
    """Assumed of the device that stops the robot, from that output to standstill."""

    @property
    def tactels(self) -> Bools:
        """(n_tactels,) which are in a region."""
        return np.asarray(np.any([region.tactels for region in self.regions], axis=0))

    def part(self, tactels: Bools) -> GuardSettings:
        """Return the guard of some of the tactels."""
        regions = tuple(replace(region, tactels=region.tactels[tactels]) for region in self.regions)
        return replace(self, regions=regions)
