"""A link that is cut in two between its boards has the contacts that it had as one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, grid
from skinbus.robot.mesh import mend
from skinbus.robot.mesh_link import Laid, lay
from tests.robot.meshes import tube

pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")

LENGTH, RADIUS, EDGE = 0.3, 0.05, 4e-3
ENDS = 0.06, 0.24
"""m, of the middles of two rings of boards: further apart than any contact reaches."""
AROUND = 2


def barrel(points):
    """The tube as a barrel: curved in two directions, 8 mm thicker in the middle."""
    r = 1.0 + 0.16 * np.sin(np.pi * points[:, 0] / LENGTH)
    return points * np.stack([np.ones_like(r), r, r], -1)


def boards():
    for ring, x in enumerate(ENDS):
        for k in range(AROUND):
            angle = 2.0 * np.pi * k / AROUND
            yield ring, barrel(np.array([[x, RADIUS * np.sin(angle), RADIUS * np.cos(angle)]]))[0]


@cache
def arms():
    """The barrel as one link and as two, both on the same board of patches."""
    points, triangles = tube(RADIUS, LENGTH, EDGE)
    points = barrel(points)
    half = points[triangles][:, :, 0].mean(axis=1) < 0.5 * LENGTH
    patch = Patch(tactels_uv=grid(4, 4, 0.010), law=Cone())
    pieces = [[triangles], [triangles[half], triangles[~half]]]
    made = []
    for parts in pieces:
        links, placed = [], []
        for number, part in enumerate(parts):
            own = [(ring, point) for ring, point in boards() if len(parts) == 1 or ring == number]
            along = np.array([1.0, 0.0, 0.0])
            laid = [
                Laid(key=f"patch[{n + 1}]", uv=np.asarray(patch.tactels_uv), point=point, along=along)
                for n, (_, point) in enumerate(own)
            ]
            surface, rows = lay(mend(points, part), laid, "barrel")
            links.append(Link(f"part {number}", surface))
            first = PlacedPatch(patch=patch, node_id=1, link=number, s=0.0, a=0.0)
            placed += [
                replace(
                    first, node_id=len(placed) + n + 1, s=row.s, a=row.a, yaw=row.yaw, on_chart=row.tactels
                )
                for n, row in enumerate(rows)
            ]
        made.append(Arm("barrel", links, placed))
    return made, [Estimator(arm, "full", budget_us=None) for arm in made]


@pytest.mark.slow
def test_tactels_are_in_the_same_places():
    one, two = arms()[0]
    places = [
        np.concatenate(
            [
                link.surface.position(arm.tactel_s[arm.tactel_link == k], arm.tactel_a[arm.tactel_link == k])[
                    0
                ]
                for k, link in enumerate(arm.links)
            ]
        )
        for arm in (one, two)
    ]
    assert np.abs(places[0] - places[1]).max() < 0.03e-3


@pytest.mark.slow
@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    tactel=st.integers(0, 2 * AROUND * 16 - 1),
    off=st.tuples(st.floats(-4e-3, 4e-3), st.floats(-4e-3, 4e-3)),
    force=st.floats(3.0, 25.0),
)
def test_contacts_of_a_mesh_are_the_same_when_its_link_is_cut_in_two(tactel, off, force):
    (one, two), estimators = arms()
    s, a = one.tactel_s[tactel] + off[0], one.tactel_a[tactel] + off[1]
    surface = one.links[0].surface
    d = surface.distance(one.tactel_s, one.tactel_a, s, a) / one.tactel_width
    pressures = one.patches[0].patch.law.pressure(d, force)
    whole, cut = (estimator.update(pressures, 20_000_000) for estimator in estimators)
    assert len(whole.s) == len(cut.s)
    places = [
        np.array([arm.links[k].surface.position(s, a)[0] for k, s, a in zip(c.link, c.s, c.a, strict=True)])
        for arm, c in ((one, whole), (two, cut))
    ]
    if len(whole.s):
        assert np.linalg.norm(places[0] - places[1], axis=1).max() < 0.15e-3
        assert cut.force == pytest.approx(whole.force, rel=0.01)
