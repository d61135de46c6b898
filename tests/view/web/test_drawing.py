"""What is drawn is what the cycle says, where the arm has it; what is not known is not drawn as known."""

import numpy as np
import pytest

from skinbus.estimate import TrackState
from skinbus.master.patches.table import PatchState
from skinbus.view.web import colours
from skinbus.view.web.drawing import LONGEST, Drawer
from skinbus.view.web.poses import Poses
from tests.view.web.cycles import ARM, made_cycle

COVARIANCE = np.diag([4e-6, 1e-6, 0.01])


def draw(*cycles, poses=None, age_s=0.0):
    drawer = Drawer(ARM, poses or Poses(ARM))
    return [drawer.draw(cycle, age_s=age_s) for cycle in cycles][-1]


def test_tactels_have_the_colours_of_their_pressures_and_grey_where_they_are_not_known():
    rng = np.random.default_rng(11)
    pressures, valid = 30e3 * rng.random(ARM.n_tactels), rng.random(ARM.n_tactels) < 0.7
    (tints,) = draw(made_cycle(1, pressures=pressures, valid=valid)).tactels
    assert (tints[valid] == colours.shades(pressures[valid])).all()
    assert (tints[~valid] == colours.UNKNOWN).all()


def test_arrow_ends_where_the_contact_is_along_its_normal_and_is_as_long_as_the_force_says():
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], (1.0, 2.0, 3.0)
    poses = Poses(ARM)
    poses.X_BS = X[None]
    drawing = draw(made_cycle(1, [{"s": 0.05, "a": 0.03, "force": 4.0}]), poses=poses)
    point, normal = ARM.links[0].surface.position(0.05, 0.03)
    ((tail, head),) = drawing.forces.points
    assert np.linalg.norm(head - (X[:3, :3] @ point + X[:3, 3])) < 2e-3
    assert tail - head == pytest.approx(0.024 * (X[:3, :3] @ normal), abs=1e-9)
    assert [label.text for label in drawing.labels] == ["1: 4.0 N"]
    ((tail, head),) = draw(made_cycle(1, [{"s": 0.05, "force": 400.0}])).forces.points
    assert np.linalg.norm(tail - head) == pytest.approx(LONGEST)


def test_ellipse_has_three_standard_deviations_and_is_drawn_only_where_they_are_known():
    contact = {"s": 0.05, "a": 0.2, "force": 4.0}
    known = contact | {"has_covariance": 1, "covariance": COVARIANCE}
    assert not len(draw(made_cycle(1, [contact])).ellipses.points)
    points = draw(made_cycle(1, [known])).ellipses.points.reshape(-1, 3)
    assert np.ptp(points[:, 0]) == pytest.approx(2 * 3 * 2e-3, rel=0.02)
    angles = np.arctan2(points[:, 1], points[:, 2])
    assert np.ptp(np.unwrap(angles)) * ARM.links[0].surface.radius == pytest.approx(2 * 3 * 1e-3, rel=0.05)


def test_lost_boards_are_crossed_out_and_bad_tactels_are_red():
    faults = np.zeros(ARM.n_tactels, np.uint8)
    faults[100] = 4
    drawing = draw(made_cycle(1, states={3: PatchState.SILENT, 5: PatchState.BOOTING}, faults=faults))
    points, tints = drawing.boards.points, drawing.boards.colours[:, 0]
    for p, tint in ((3, colours.LOST), (5, colours.WAITING)):
        centre, _ = ARM.links[0].surface.position(ARM.patch_s[p], ARM.patch_a[p])
        far = np.linalg.norm(points[(tints == tint).all(1)] - centre, axis=-1)
        assert (far.min() < 0.003) == (p == 3)
        assert 0.033 < far.max() < 0.037
    assert tuple(drawing.tactels[0][100]) == colours.LOST
    assert not len(draw(made_cycle(1)).boards.points)


def test_nothing_of_a_stale_cycle_is_drawn_as_of_now():
    cycle = made_cycle(7, [{"s": 0.05, "force": 4.0}], pressures=np.full(ARM.n_tactels, 1e4))
    stale = draw(cycle, age_s=1.0)
    assert stale.is_stale
    assert (stale.tactels[0] == colours.UNKNOWN).all()
    assert not len(stale.forces.points)
    assert not stale.labels


def test_contact_that_has_gone_or_is_on_an_unknown_link_is_not_drawn():
    lifted = {"s": 0.05, "state": TrackState.LIFT}
    drawing = draw(made_cycle(1, [lifted, {"id": 2, "link": 7, "force": 1.0}]))
    assert not len(drawing.forces.points)
