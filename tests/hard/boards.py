"""The table of hard cases, third part: boards that are odd."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Quality
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface, grid
from tests.hard.check import Case, Must, Situation
from tests.hard.ground import PITCH, Ground, law_of, touch
from tests.hard.places import PAPER, read
from tests.hard.readings import USUAL

Floats = npt.NDArray[np.float64]


def _odd_board(uv: Floats, spot: tuple[float, float], ground: Ground, force: float = 5.0) -> Situation:
    arm = ground.board(uv)
    return read(arm, [touch(arm, 0, *spot, force)])


def _turned(yaw: float, mirror: bool, ground: Ground) -> Situation:
    """The board under the contact is turned, or its tactels are numbered from the other side."""
    usual = ground.arm()
    uv = grid(4, 4, PITCH) * ([-1.0, 1.0] if mirror else [1.0, 1.0])
    patches = [replace(p, yaw=yaw, patch=replace(p.patch, tactels_uv=uv)) for p in usual.patches]
    arm = Arm("turned", usual.links, patches)
    return read(arm, [touch(arm, 1, 0.002, 0.001, 5.0)])


def _overlapping(ground: Ground) -> Situation:
    """Two boards on the same place, a tenth of a pitch apart: two patches respond to every contact."""
    usual = ground.arm()
    twin = replace(usual.patches[1], node_id=99, s=usual.patches[1].s + 1e-3)
    arm = Arm("overlapping", usual.links, [*usual.patches, twin])
    return read(arm, [touch(arm, 1, 0.002, 0.001, 5.0)])


def _near_tip(ground: Ground) -> Situation | None:
    """A small board where the frustum is 8 mm thick, with its tip 31 mm further on."""
    if ground.surface != "frustum":
        return None
    surface = Surface.cone(0.20, 0.030, 0.001)
    patch = Patch(tactels_uv=grid(4, 4, 3e-3), size=(0.012, 0.012), law=law_of(ground.law))
    placed = PlacedPatch(patch=patch, node_id=1, link=0, s=0.18, a=0.0)
    arm = Arm("tip", [Link("tip", surface)], [placed])
    return read(arm, [touch(arm, 0, 0.001, 0.0005, 0.5)])


def _huge_radius(ground: Ground) -> Situation | None:
    if ground.surface != "cylinder":
        return None
    link = Link("earth", Surface.cylinder(0.1, 1e6))
    placed = PlacedPatch(
        patch=Patch(tactels_uv=grid(4, 4, PITCH), law=law_of(ground.law)), node_id=1, link=0, s=0.05, a=0.0
    )
    arm = Arm("earth", [link], [placed])
    return read(arm, [touch(arm, 0, 0.002, 0.001, 5.0)])


def _two_laws(ground: Ground) -> Situation:
    """A contact on the seam between a board under a cone and one under a radial law."""
    usual = ground.arm()
    laws = [law_of("cone"), law_of("radial")]
    patches = [replace(p, patch=replace(p.patch, law=laws[n % 2])) for n, p in enumerate(usual.patches)]
    arm = Arm("two laws", usual.links, patches)
    return read(arm, [touch(arm, 1, 0.002, 0.0225, 15.0)])


BOARDS: Final = (
    Case(
        name="board of one tactel",
        why="one reading, three unknowns; no extent",
        holds="at the tactel, few tactels",
        must=Must(place=PITCH, says=Quality.FEW_TACTELS),
        build=partial(_odd_board, np.zeros((1, 2)), (0.002, 0.001)),
    ),
    Case(
        name="board of two tactels",
        why="the mirror image fits as well",
        holds="within a pitch",
        must=Must(place=PITCH, says=Quality.FEW_TACTELS),
        build=partial(_odd_board, np.array([[-0.005, 0.0], [0.005, 0.0]]), (0.001, 0.001)),
    ),
    Case(
        name="board of one row",
        why="across it only the distance is known",
        holds="within a pitch and within its covariance",
        must=Must(place=PITCH),
        build=partial(_odd_board, grid(6, 1, 8e-3), (0.001, 0.003)),
    ),
    Case(
        name="two tactels at one place",
        why="distance 0 between tactels",
        holds="fits exact",
        must=USUAL,
        build=partial(_odd_board, np.concatenate([grid(4, 4, PITCH), [[0.005, 0.005]]]), (0.002, 0.001)),
    ),
    Case(
        name="64 tactels 1 mm apart",
        why="dense: hundreds of equal distances",
        holds="fits exact",
        must=Must(place=(PAPER, 1e-5, 1e-5), force=(1.5, 1e-3, 1e-3)),
        build=partial(_odd_board, grid(8, 8, 1e-3), (0.0004, 0.0002)),
    ),
    Case(
        name="board turned by 90 degrees",
        why="cosine of yaw is 6e-17, not 0",
        holds="fits exact",
        must=USUAL,
        build=partial(_turned, 0.5 * math.pi, False),
    ),
    Case(
        name="board mirrored",
        why="tactels in the other order",
        holds="fits exact",
        must=USUAL,
        build=partial(_turned, 0.0, True),
    ),
    Case(
        name="board turned by 45 degrees",
        why="tactels of neighbours overlap",
        holds="fits exact",
        must=USUAL,
        build=partial(_turned, 0.25 * math.pi, False),
    ),
    Case(
        name="two boards on one place",
        why="one contact, two patches respond to all of it",
        holds="one contact, exact",
        must=USUAL,
        build=_overlapping,
    ),
    Case(
        name="frustum near its tip",
        why="a turn is 25 mm; a stretches by 5 against the surface",
        holds="one contact, exact",
        must=Must(place=(PAPER, 1e-4, 1e-4), force=(3.0, 0.05, 0.05)),
        build=_near_tip,
    ),
    Case(
        name="cylinder of 1000 km radius",
        why="the plane as a limit: a / radius is 1e-9",
        holds="fits exact",
        must=USUAL,
        build=_huge_radius,
    ),
    Case(
        name="two laws under one contact",
        why="one force, two shapes",
        holds="one contact",
        must=Must(place=(2 * PITCH, 1e-4, 1e-4), force=(3.0, 0.01, 0.01)),
        build=_two_laws,
    ),
)
