"""Effects of a real skin, with the law that ships: what is published of them beside the truth.

Fingers press and let go in random places of the arm "pad"; the master runs as it is delivered.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

import skinbus
from skinbus.estimate import Quality
from skinbus.skin.cycle import Contact, Cycle, Touch
from tests.hard.check import SIGMAS

PITCH: Final = 6.0e-3
"""m, of the board: a contact further from every touch than this is false, a touch without one is missed."""
SEED: Final = 20261122
N_TOUCHES: Final = 8
MOST_MISSED: Final = 0.05
"""Of the cycles with a touch: the first one of a touch that lands may not do yet."""
MARGIN_MM: Final = 8.0
"""From the rim of the board, so that what is measured is the effect."""

EFFECTS: Final[dict[str, tuple[str, str]]] = {
    "nothing else": ('shape = "disc"\ndiameter_mm = 12.0', ""),
    "inclined push": (
        'shape = "disc"\ndiameter_mm = 12.0\ninclination = 0.3\ndirection_deg = 40.0',
        "[effect.shear]",
    ),
    "growing contact": ('shape = "sphere"\ndiameter_mm = 16.0', ""),
    "impact": ('shape = "disc"\ndiameter_mm = 12.0\nimpact_n = 20.0\nimpact_ms = 10.0', ""),
    "burst": ('shape = "disc"\ndiameter_mm = 12.0', "[effect.burst]\nper_minute = 120.0"),
    "zeros move": ('shape = "disc"\ndiameter_mm = 12.0', "[effect.thermal]\nend_c = 4.0\ntau_s = 60.0"),
    "zeros move in a touch": (
        'shape = "disc"\ndiameter_mm = 12.0',
        "[effect.thermal]\nend_c = 3.0\ntau_s = 70.0\nboard_sigma_c = 0.0",
    ),
}
"""A touch, and what the scene has beside noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectOutcome:
    """What one level published of the touches under one effect; unseen touches of half a newton count not."""

    n_touches: int
    """Cycles in which a touch was there, counted for each."""
    n_missed: int
    n_false: int
    """Contacts with no touch within a pitch."""
    n_flagged: int
    """Of those at a touch."""
    n_beyond: int
    """Unflagged, and further from the touch than six standard deviations in place or force."""
    worst_mm: float
    worst_force: float
    """Relative."""

    @property
    def faults(self) -> tuple[str, ...]:
        """What must not be, whatever the effect."""
        said = []
        if self.n_beyond:
            said.append(
                f"{self.n_beyond} contacts beyond {SIGMAS:g} of their standard deviations, without a flag"
            )
        if self.n_missed > MOST_MISSED * self.n_touches:
            said.append(f"{self.n_missed} of {self.n_touches} touches missed")
        return tuple(said)


def run_effect(name: str, level: str, seed: int = SEED) -> EffectOutcome:
    """Return what a level publishes of touches under an effect."""
    with TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(_scene(name, seed))
        with skinbus.simulate(scene, level=level) as skin:
            return _judge(skin, with_sd=level != "kmeans")


def _scene(name: str, seed: int) -> str:
    shape, effects = EFFECTS[name]
    rng = np.random.default_rng(seed)
    is_long = name == "zeros move in a touch"
    n, on_s, off_s = (1, 70.0, 1.0) if is_long else (N_TOUCHES, 0.5, 0.4)
    touches = []
    for k in range(n):
        s, a = rng.uniform(MARGIN_MM, 50.0 - MARGIN_MM), rng.uniform(MARGIN_MM - 25.0, 25.0 - MARGIN_MM)
        begin = 1.0 + k * (on_s + off_s)
        touches.append(
            f'[[touch]]\nlink = "plate"\n{shape}\ns_mm = {s:.2f}\na_mm = {a:.2f}\n'
            f"force_n = {rng.uniform(2.0, 10.0):.2f}\nstart_s = {begin:.3f}\nend_s = {begin + on_s:.3f}\n"
        )
    head = f'[scene]\ntitle = "{name}"\narm = "pad"\nseed = {seed}\nduration_s = {begin + on_s + 0.5:.1f}\n'
    return head + "".join(touches) + effects + "\n[effect.noise]\n"


def _judge(cycles: Iterator[Cycle], *, with_sd: bool) -> EffectOutcome:
    n_touches = n_missed = n_false = n_flagged = n_beyond = 0
    worst_mm = worst_force = 0.0
    for cycle in cycles:
        there = [touch for touch in cycle.truth if touch.force > 0.5]
        seen = [contact for contact in cycle.contacts if contact.seen_ns == cycle.t_ns]
        n_touches += len(there)
        n_missed += sum(all(_apart(touch, contact) > PITCH for contact in seen) for touch in there)
        for contact in seen:
            near = [touch for touch in cycle.truth if _apart(touch, contact) <= PITCH]
            if not near:
                n_false += 1
                continue
            (touch,) = near
            if touch.force <= 0.5:
                continue
            worst_mm = max(worst_mm, 1e3 * _apart(touch, contact))
            worst_force = max(worst_force, abs(contact.force / touch.force - 1.0))
            is_flagged = contact.quality is None or contact.quality != Quality.GOOD
            n_flagged += is_flagged
            n_beyond += with_sd and not is_flagged and _is_beyond(touch, contact)
    return EffectOutcome(
        n_touches=n_touches,
        n_missed=n_missed,
        n_false=n_false,
        n_flagged=n_flagged,
        n_beyond=n_beyond,
        worst_mm=worst_mm,
        worst_force=worst_force,
    )


def _apart(touch: Touch, contact: Contact) -> float:
    return float(np.hypot(contact.s - touch.s, contact.a - touch.a))


def _is_beyond(touch: Touch, contact: Contact) -> bool:
    error = np.array([contact.s - touch.s, contact.a - touch.a, contact.force - touch.force])
    if contact.covariance is None:
        return True
    return bool((np.abs(error) > SIGMAS * np.sqrt(np.diag(contact.covariance))).any())
