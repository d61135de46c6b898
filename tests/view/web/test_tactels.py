"""Tactels on the page: where they are, in their shade, and sent again only where that has changed."""

from types import SimpleNamespace

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.view.web import colours
from skinbus.view.web.poses import in_a_row, placed
from skinbus.view.web.solids import OVER
from skinbus.view.web.tactels import MANY, N_SHADES, DiscTactels, add_tactels

ARM = load_arm("arm", check_load=False)
POSES = in_a_row(ARM)


class Node(SimpleNamespace):
    """A mesh of a scene; counts how often its squares were sent."""

    n_sent = 0

    def __setattr__(self, name, value):
        super().__setattr__(name, value)
        if name == "faces":
            super().__setattr__("n_sent", self.n_sent + 1)


class Scene:
    """What is added to a scene, by name."""

    def __init__(self):
        self.nodes = {}

    def add_mesh_simple(self, name, vertices, faces, **props):
        node = self.nodes[name] = Node(vertices=vertices, faces=faces, **props)
        return node

    def add_batched_meshes_simple(self, name, vertices, faces, wxyz, positions, **props):
        node = self.nodes[name] = Node(vertices=vertices, faces=faces, positions=positions, **props)
        return node


def by_link(tints):
    return tuple(tints[ARM.tactel_link == k] for k in range(len(ARM.links)))


def squares(scene):
    """Centres (n, 3), areas (n,) and colours (n, 3) of what is seen."""
    shown = [node for node in scene.nodes.values() if node.visible]
    corners = [node.vertices[node.faces.reshape(-1, 2, 3)] for node in shown]  # two triangles each
    tints = [np.tile(node.color, (len(part), 1)) for node, part in zip(shown, corners, strict=True)]
    corners = np.concatenate(corners)
    a, b, c = np.moveaxis(corners, 2, 0)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum(1)
    return 0.5 * (corners.min((1, 2)) + corners.max((1, 2))), areas, np.concatenate(tints)


@pytest.fixture
def pressures():
    return np.random.default_rng(2).uniform(0.0, 30e3, ARM.n_tactels)


def test_many_tactels_are_squares_at_their_places_in_the_nearest_shade(pressures):
    assert ARM.n_tactels > MANY
    tints = colours.shades(pressures)
    tints[5] = colours.UNKNOWN
    scene = Scene()
    add_tactels(scene, ARM, POSES).show(by_link(tints))
    centres, areas, seen = squares(scene)
    wanted = np.zeros((ARM.n_tactels, 3))
    for k, link in enumerate(ARM.links):
        here = ARM.tactel_link == k
        points, normals = link.surface.position(ARM.tactel_s[here], ARM.tactel_a[here])
        wanted[here] = placed(POSES.X_BS[k], points + OVER * normals)
    apart = np.linalg.norm(wanted[:, None] - centres, axis=-1)
    at = apart.argmin(1)
    assert np.unique(at).size == ARM.n_tactels == len(centres)
    assert apart.min(1).max() < 0.2e-3  # their corners are at that height, and the link is round
    assert areas == pytest.approx(0.25 * np.pi * ARM.patches[0].patch.diameter ** 2, rel=0.02)
    middles = (np.minimum(pressures / 30e3 * N_SHADES, N_SHADES - 1).astype(int) + 0.5) / N_SHADES
    shades = colours.shades(middles, 1.0)
    shades[5] = colours.UNKNOWN
    same = [tuple(seen[at[t]]) == colours.for_mesh(tuple(shades[t])) for t in range(ARM.n_tactels)]
    assert np.mean(same) > 0.95  # between two shades the nearest colour is that of either pressure
    assert same[5]


def test_only_shades_with_other_tactels_are_sent_again_and_all_when_links_move(pressures):
    scene = Scene()
    tactels = add_tactels(scene, ARM, POSES)
    tactels.show(by_link(colours.shades(pressures)))
    before = [node.n_sent for node in scene.nodes.values()]
    pressures[7] = 0.0 if pressures[7] > 15e3 else 30e3
    tactels.show(by_link(colours.shades(pressures + 1.0)))
    sent = np.subtract([node.n_sent for node in scene.nodes.values()], before)
    assert (sent.sum(), sent.max()) == (2, 1)
    X_BS = POSES.X_BS.copy()
    X_BS[:, 2, 3] += 0.5
    tactels.move(type(POSES)(X_BS, ""))
    tactels.show(by_link(colours.shades(pressures + 1.0)))
    assert squares(scene)[0][:, 2].min() > 0.4


def test_few_tactels_are_discs_of_any_colour():
    arm = load_arm("pad")
    scene = Scene()
    tactels = add_tactels(scene, arm, in_a_row(arm))
    assert isinstance(tactels, DiscTactels)
    tints = colours.shades(np.linspace(0.0, 30e3, arm.n_tactels))
    tactels.show((tints,))
    (node,) = scene.nodes.values()
    assert len(np.unique(node.batched_colors, axis=0)) == arm.n_tactels == len(node.positions)
