"""The skins of the accuracy tables: what is pressed, what it truly feels, and what is read of that.

A skin is an arm as the estimator is given it, and a truth: a layer of the simulator, tactels with gains that
the estimator is not given, noise and counts. The paper's board, a forearm of it and layouts of triangles feel
by the cone itself; a board of rubber feels by an elastic layer under discs and is calibrated by presses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import learn_radial_law
from skinbus.model import Arm, Cone, Law, Link, Patch, PlacedPatch, Surface, Transducer
from skinbus.model.patch import grid
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.laws import ConeSettings, Elastic, LayerSettings
from skinbus.sim.layer import Geometry, Loads

Floats = npt.NDArray[np.float64]

PITCH: Final = 0.010
FULL_SCALE: Final = 250e3
NOISE: Final = 200.0
"""Pa: 1 % of the peak under a usual touch, as in the EDS files."""
CONE_SLOPE: Final = 4e6
"""Pa/m: the cone nearest to the elastic layer of 6 mm."""
GAIN_SPREAD: Final = 0.03
PRESSES: Final = 200
BITS: Final = 12


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


def pad_cone(rng: np.random.Generator) -> SkinModel:
    """Return the paper's board alone; the cone is the truth."""
    return _cone_skin(Arm.single_patch(grid(4, 4, PITCH)))


def forearm_cone(rng: np.random.Generator) -> SkinModel:
    """Return three rings of eight of the paper's boards, seams of 0 to 2 mm; the cone is the truth."""
    return _cone_skin(cone_forearm())


def hexagon_cone(rng: np.random.Generator) -> SkinModel:
    """Return six triangles around a point, 61 tactels at 6.9 and 8 mm; the cone is the truth."""
    return _cone_skin(Arm.single_patch(layout("hexagon")[:, 1:]))


def shell_cone(rng: np.random.Generator) -> SkinModel:
    """Return half a tube of 60 triangles, each a patch of 10 or 11 tactels; the cone is the truth."""
    return _cone_skin(_shell())


def pad_tip(rng: np.random.Generator) -> SkinModel:
    """Return a calibrated board of rubber, pressed by a tip of 2 mm."""
    return _real_skin(0.001, rng)


def pad_finger(rng: np.random.Generator) -> SkinModel:
    """Return a calibrated board of rubber, pressed by a disc of 12 mm."""
    return _real_skin(0.006, rng)


def pad_thumb_unforeseen(rng: np.random.Generator) -> SkinModel:
    """Return a board of rubber, calibrated with a disc of 12 mm and pressed by one of 25 mm."""
    return _real_skin(0.006, rng, pressed_by=0.0125)


def pad_tip_unforeseen(rng: np.random.Generator) -> SkinModel:
    """Return a board of rubber, calibrated with a disc of 12 mm and pressed by a tip of 2 mm."""
    return _real_skin(0.006, rng, pressed_by=0.001)


def layout(name: str) -> Floats:
    """Return the tactels of a layout that ships with the study: patch, s, a (m), (n, 3)."""
    source = files("skinbus.study").joinpath("layouts", f"{name}.csv")
    with source.open() as lines:
        return np.loadtxt(lines, delimiter=",", comments="#", ndmin=2)


def _cone_skin(arm: Arm) -> SkinModel:
    def read(pressures: Floats, rng: np.random.Generator) -> Floats:
        return np.asarray(pressures + NOISE * rng.standard_normal(len(pressures)))

    return SkinModel(arm, feel_of(arm, ConeSettings(), 0.0), read, NOISE)


def _real_skin(indenter: float, rng: np.random.Generator, *, pressed_by: float | None = None) -> SkinModel:
    """Return a rubber board with its own gains, calibrated by presses with an indenter (radius, m).

    ``pressed_by`` (radius, m) is what touches it afterwards, by default the same.
    """
    transducer = Transducer(full_scale=FULL_SCALE, bits=BITS)
    # the boards ship with the cone nearest to the layer; calibration replaces it
    arm = Arm.single_patch(grid(4, 4, PITCH), law=Cone(CONE_SLOPE), transducer=transducer)
    feel = feel_of(arm, Elastic(), indenter)
    response = 1.0 + GAIN_SPREAD * rng.standard_normal(arm.n_tactels)
    noise = 0.01 * float(feel(np.array([[0.5 * PITCH, 0.5 * PITCH, 5.0]])).max())

    def read_with(gain: Floats) -> Callable[[Floats, np.random.Generator], Floats]:
        def read(pressures: Floats, rng: np.random.Generator) -> Floats:
            felt = pressures * response + noise * rng.standard_normal(len(pressures))
            return np.asarray(transducer.pressure(transducer.counts(felt)) * gain)

        return read

    raw = read_with(np.ones(arm.n_tactels))
    half = 0.020  # m: the hull of the tactels, and half a pitch around it
    touches = np.column_stack([rng.uniform(-half, half, (PRESSES, 2)), rng.uniform(2.0, 20.0, PRESSES)])
    readings = np.stack([raw(feel(touch[None]), rng) for touch in touches])
    learned = learn_radial_law(arm, touches[:, 0], touches[:, 1], touches[:, 2], readings)
    if pressed_by is not None:
        feel = feel_of(arm, Elastic(), pressed_by)
    return SkinModel(learned.apply(arm), feel, read_with(learned.gain), noise)


def box(rng: np.random.Generator) -> SkinModel:
    """Return a board out of the box, pressed by a disc of 12 mm: the shipped law, gains it is not given."""
    return _plain_skin(_shipped_pad(), 0.006, rng)


def box_thumb(rng: np.random.Generator) -> SkinModel:
    """Return such a board, pressed by a disc of 25 mm."""
    return _plain_skin(_shipped_pad(), 0.0125, rng)


def box_tip(rng: np.random.Generator) -> SkinModel:
    """Return such a board, pressed by a tip of 2 mm."""
    return _plain_skin(_shipped_pad(), 0.001, rng)


def box_forearm(rng: np.random.Generator) -> SkinModel:
    """Return a forearm of such boards, pressed by a disc of 12 mm."""
    return _plain_skin(cone_forearm().with_law(shipped_law()), 0.006, rng)


def shipped_law() -> Law:
    """Return the law of the usual board as its EDS holds it."""
    return describe_patch(load_eds("skin-patch", 1)).law


def _shipped_pad() -> Arm:
    return Arm.single_patch(grid(4, 4, PITCH), law=shipped_law())


def _plain_skin(arm: Arm, indenter: float, rng: np.random.Generator) -> SkinModel:
    response = 1.0 + GAIN_SPREAD * rng.standard_normal(arm.n_tactels)

    def read(pressures: Floats, rng: np.random.Generator) -> Floats:
        return np.asarray(pressures * response + NOISE * rng.standard_normal(len(pressures)))

    return SkinModel(arm, feel_of(arm, Elastic(), indenter), read, NOISE)


def feel_of(arm: Arm, layer: LayerSettings, indenter: float) -> Callable[[Floats], Floats]:
    """Return what an arm feels under a layer, of touches by a disc of this radius (m)."""
    law = layer.bind(Geometry.of(arm, discs=layer.discs), np.array([indenter]))
    loads = Loads(16)

    def feel(touches: Floats) -> Floats:
        pressures = np.zeros(arm.n_tactels)
        loads.n = len(touches)
        loads.s[: loads.n], loads.a[: loads.n], loads.force[: loads.n] = touches.T
        law.add(loads, pressures)
        return pressures

    return feel


@lru_cache(maxsize=2)
def cone_forearm(rings: int = 3) -> Arm:
    """Return rings of eight of the paper's boards, seams of 0 and 2 mm between rings."""
    patch = Patch.default()
    pitch, around = 0.051, 8
    surface = Surface.cylinder(0.052 * rings, around * pitch / (2.0 * np.pi))
    placed: list[PlacedPatch] = []
    for ring in range(rings):
        s = 0.026 + 0.050 * ring + 0.002 * (ring // 2)
        for i in range(around):
            a = float(surface.wrap(i * pitch))
            placed.append(PlacedPatch(patch=patch, node_id=len(placed) + 1, link=0, s=s, a=a))
    return Arm("forearm", [Link("forearm", surface)], placed)


@lru_cache(maxsize=1)
def _shell() -> Arm:
    """Return the shell, every triangle a patch at the middle of its tactels."""
    rows = layout("shell")
    numbers, place = rows[:, 0].astype(int), rows[:, 1:]
    margin = 0.008  # m: a pitch around the outer tactels, as between triangles
    surface = Surface.cylinder(float(place[:, 0].max()) + margin, SHELL_RADIUS)
    placed: list[PlacedPatch] = []
    for number in np.unique(numbers):
        own = place[numbers == number]
        middle = 0.5 * (own.min(axis=0) + own.max(axis=0))
        size = np.ptp(own, axis=0) + margin
        patch = Patch(tactels_uv=own - middle, diameter=4e-3, size=(float(size[0]), float(size[1])))
        placed.append(
            PlacedPatch(patch=patch, node_id=len(placed) + 1, link=0, s=float(middle[0]), a=float(middle[1]))
        )
    return Arm("shell", [Link("shell", surface)], placed)


SHELL_RADIUS: Final = 0.0716
"""m, of the tube that lies nearest to the triangles of the shell."""

SKINS: Final[dict[str, Callable[[np.random.Generator], SkinModel]]] = {
    "pad": pad_cone,
    "forearm": forearm_cone,
    "hexagon": hexagon_cone,
    "shell": shell_cone,
    "tip": pad_tip,
    "finger": pad_finger,
    "finger, thumb": pad_thumb_unforeseen,
    "finger, tip": pad_tip_unforeseen,
    "box": box,
    "box thumb": box_thumb,
    "box tip": box_tip,
    "box forearm": box_forearm,
}
