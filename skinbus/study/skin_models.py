"""The skins of the accuracy tables: what is pressed, what it truly feels, and what is read of that.

A skin is an arm as the estimator is given it, and a truth: a layer of the simulator, tactels with gains that
the estimator is not given, noise and counts. The paper's board, a forearm of it and a layout of triangles
feel by the cone itself. A board of rubber feels by an elastic layer under discs; it is calibrated by presses,
or has the law that boards ship with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib.resources import files
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import learn_radial_law
from skinbus.model import Arm, Cone, Law, Link, Patch, PlacedPatch, Surface, Transducer
from skinbus.model.patch import grid
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import ConeSettings, Elastic, LayerSettings
from skinbus.sim.layer import Geometry, Loads

Floats = npt.NDArray[np.float64]

PITCH: Final = 0.010
NOISE: Final = 200.0
"""Pa: 1 % of the peak under a usual touch, as in the EDS files."""
CONE_SLOPE: Final = 4e6
"""Pa/m: the cone nearest to the elastic layer of 6 mm."""
GAIN_SPREAD: Final = 0.03
PRESSES: Final = 200
TRANSDUCER: Final = Transducer(full_scale=250e3, bits=12)
TIP, FINGER, THUMB = 0.001, 0.006, 0.0125
"""m, radii of what presses."""


@dataclass(frozen=True, slots=True)
class SkinModel:
    """An arm as the estimator is given it, and its true response and readings."""

    arm: Arm
    feel: Callable[[Floats], Floats]
    """Pressures (n_tactels,) Pa of touches (n, 3): s, a (m), force (N) on link 0."""
    read: Callable[[Floats, np.random.Generator], Floats]
    """What the estimator is given for true pressures: noise, counts, calibration."""
    noise: float
    """Standard deviation of a reading, Pa."""


def layout(name: str) -> Floats:
    """Return the tactels of a layout that ships with the study: number of the triangle, s, a (m), (n, 3)."""
    source = files("skinbus.study").joinpath("layouts", f"{name}.csv")
    with source.open() as lines:
        return np.loadtxt(lines, delimiter=",", comments="#", ndmin=2)


def feel_of(arm: Arm, layer: LayerSettings, indenter: float) -> Callable[[Floats], Floats]:
    """Return what an arm feels under a layer, of touches by a disc of this radius (m)."""
    law = layer.bind(Geometry.of(arm, discs=layer.discs), [Indenter(Shape.DISC, 2.0 * indenter)])

    def feel(touches: Floats) -> Floats:
        pressures, (s, a, force) = np.zeros(arm.n_tactels), touches.T
        law.add(Loads(len(s), s=s, a=a, force=force), pressures)
        return pressures

    return feel


def shipped_law() -> Law:
    """Return the law of the usual board as its EDS holds it."""
    return describe_patch(load_eds("skin-patch", 1)).law


def board(law: Law) -> Arm:
    """Return the paper's board with a law."""
    return Arm.single_patch(grid(4, 4, PITCH), law=law, transducer=TRANSDUCER)


@lru_cache(maxsize=2)
def cone_forearm(rings: int = 3) -> Arm:
    """Return rings of eight of the paper's boards, seams of 0 and 2 mm between rings."""
    pitch, around = 0.051, 8
    surface = Surface.cylinder(0.052 * rings, around * pitch / (2.0 * np.pi))
    places = [
        (0.026 + 0.050 * ring + 0.002 * (ring // 2), float(surface.wrap(i * pitch)))
        for ring in range(rings)
        for i in range(around)
    ]
    patch = Patch.default()
    placed = [PlacedPatch(patch=patch, node_id=k, link=0, s=s, a=a) for k, (s, a) in enumerate(places, 1)]
    return Arm("forearm", [Link("forearm", surface)], placed)


def _cone_skin(arm_of: Callable[[], Arm], rng: np.random.Generator) -> SkinModel:
    """Return a skin whose truth is the cone that the estimator has."""

    def read(pressures: Floats, rng: np.random.Generator) -> Floats:
        return np.asarray(pressures + NOISE * rng.standard_normal(len(pressures)))

    arm = arm_of()
    return SkinModel(arm, feel_of(arm, ConeSettings(), 0.0), read, NOISE)


def _calibrated_skin(learned_with: float, pressed_by: float, rng: np.random.Generator) -> SkinModel:
    """Return a board of rubber calibrated by presses; radii of indenters, m."""
    arm = board(Cone(CONE_SLOPE))
    feel = feel_of(arm, Elastic(), learned_with)
    response = 1.0 + GAIN_SPREAD * rng.standard_normal(arm.n_tactels)
    noise = 0.01 * float(feel(np.array([[0.5 * PITCH, 0.5 * PITCH, 5.0]])).max())

    def read(pressures: Floats, rng: np.random.Generator, gain: Floats | float = 1.0) -> Floats:
        felt = pressures * response + noise * rng.standard_normal(len(pressures))
        return np.asarray(TRANSDUCER.pressure(TRANSDUCER.counts(felt)) * gain)

    half = 0.020  # m: the hull of the tactels, and half a pitch around it
    touches = np.column_stack([rng.uniform(-half, half, (PRESSES, 2)), rng.uniform(2.0, 20.0, PRESSES)])
    readings = np.stack([read(feel(touch[None]), rng) for touch in touches])
    learned = learn_radial_law(arm, touches[:, 0], touches[:, 1], touches[:, 2], readings)
    feel = feel_of(arm, Elastic(), pressed_by)
    return SkinModel(learned.apply(arm), feel, partial(read, gain=learned.gain), noise)


def _shipped_skin(arm_of: Callable[[], Arm], indenter: float, rng: np.random.Generator) -> SkinModel:
    """Return rubber with the law that boards ship with and gains that the estimator is not given."""
    arm = arm_of().with_law(shipped_law())
    response = 1.0 + GAIN_SPREAD * rng.standard_normal(arm.n_tactels)

    def read(pressures: Floats, rng: np.random.Generator) -> Floats:
        return np.asarray(pressures * response + NOISE * rng.standard_normal(len(pressures)))

    return SkinModel(arm, feel_of(arm, Elastic(), indenter), read, NOISE)


def _pad() -> Arm:
    return Arm.single_patch(grid(4, 4, PITCH))


SKINS: Final[dict[str, Callable[[np.random.Generator], SkinModel]]] = {
    "pad": partial(_cone_skin, _pad),
    "forearm": partial(_cone_skin, cone_forearm),
    "hexagon": partial(_cone_skin, lambda: Arm.single_patch(layout("hexagon")[:, 1:])),
    "tip": partial(_calibrated_skin, TIP, TIP),
    "finger": partial(_calibrated_skin, FINGER, FINGER),
    "finger, thumb": partial(_calibrated_skin, FINGER, THUMB),
    "finger, tip": partial(_calibrated_skin, FINGER, TIP),
    "box": partial(_shipped_skin, _pad, FINGER),
    "box thumb": partial(_shipped_skin, _pad, THUMB),
    "box tip": partial(_shipped_skin, _pad, TIP),
    "box forearm": partial(_shipped_skin, cone_forearm, FINGER),
}
"""Of the cone; calibrated with and pressed by; out of the box. "hexagon" is six triangles around a point."""
