"""Contacts in the frames of the robot: joint positions from a program, and what is not known without them."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import skinbus
from skinbus.errors import ArgumentError, LocalProtocolError
from skinbus.estimate import TrackState
from tests.robot.two_joints import FROM_PYTHON, write
from tests.skin.scenes import write as write_slide

pytestmark = pytest.mark.slow

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")


@pytest.fixture
def scene(tmp_path):
    return str(write(tmp_path, FROM_PYTHON) / "scene.toml")


def turn(first, second):
    """The plate in the base by hand: at the elbow, turned by the first about z, by the second about y."""
    cos, sin = math.cos(first), math.sin(first)
    R = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    cos2, sin2 = math.cos(second), math.sin(second)
    tilt = np.array([[cos2, 0, sin2], [0, 1, 0], [-sin2, 0, cos2]])
    return R @ tilt, R @ [0.5, 0.0, 0.0] + [0.0, 0.0, 0.3]


def run(skin, angles, seconds):
    """The cycles up to a time, with joint positions set as they are after each."""
    cycles = []
    for cycle in skin:
        cycles.append(cycle)
        skin.joints = angles(1e-9 * cycle.ended_ns)
        if cycle.t_ns > 1e9 * seconds:
            return cycles
    raise AssertionError("the scene is over")


def test_a_contact_is_in_every_frame_where_the_moving_arm_has_it(scene):
    def angles(t):
        return [1.0 * t, 0.4 - 0.3 * t]

    with skinbus.simulate(scene) as skin:
        assert skin.joint_names == ("first", "second")
        assert np.isnan(skin.joints).all()
        cycles = run(skin, angles, 1.0)
        assert_array_equal(skin.joints, cycles[-1].joint_positions)
    touched = [cycle for cycle in cycles if cycle.contacts and cycle.t_ns > 0.6e9]
    assert len(touched) > 30
    for cycle in touched:
        (contact,) = cycle.contacts
        q = angles(1e-9 * cycle.t_ns)
        assert cycle.robot_valid
        assert_allclose(cycle.joint_positions, q, atol=1e-9)
        R, p = turn(*q)
        in_plate = np.array([contact.s, contact.a, 0.0])
        for frame in ("surface", "link"):
            assert_allclose(contact.point(frame), in_plate)
        assert_allclose(contact.point("base"), R @ in_plate + p, atol=1e-9)
        assert_allclose(contact.normal("base"), R[:, 2], atol=1e-9)
        force = -contact.force * R[:, 2]
        assert_allclose(contact.force_vector(), force, atol=1e-9)
        assert_allclose(contact.force_vector("link"), [0, 0, -contact.force], atol=1e-9)
        assert_allclose(cycle.joint_torques, contact.jacobian[:3].T @ force, atol=1e-9)
        # even motion: the covariance is that of the contact, turned
        flat = R[:, :2] @ contact.covariance[:2, :2] @ R[:, :2].T
        assert_allclose(contact.point_covariance("base"), flat, rtol=1e-4, atol=1e-12)


def test_a_contact_that_is_not_seen_has_no_place_in_the_base(tmp_path):
    folder = write(tmp_path, FROM_PYTHON)
    scene = folder / "scene.toml"
    scene.write_text(scene.read_text().replace("end_s = 9.0", "end_s = 0.6"))
    with skinbus.simulate(str(scene)) as skin:
        cycles = run(skin, lambda t: [0.1, 0.2], 1.0)
    unseen = [c for cycle in cycles for c in cycle.contacts if c.state in (TrackState.COAST, TrackState.LIFT)]
    assert unseen
    for contact in unseen:
        assert np.isnan(contact.point("base")).all()
        assert np.isfinite(contact.point("link")).all()


def test_what_cannot_be_set_is_refused(scene, tmp_path):
    with skinbus.simulate(scene) as skin:
        for bad, why in (
            ([1.0], r"wanted \(2,\)"),
            ({"third": 0.0}, "no joint 'third'"),
            ([math.nan, 0], "finite"),
            ([30, 60], r"'first' at 30 rad; wanted -3 to 3 rad.*radians, not degrees"),
            ({"second": -3.2}, "'second' at -3.2 rad"),
        ):
            with pytest.raises(ArgumentError, match=why):
                skin.joints = bad
    with skinbus.simulate(write_slide(tmp_path)) as skin:
        assert skin.joint_names == ()
        with pytest.raises(LocalProtocolError, match=r"need \[robot\]"):
            skin.joints = [0.0]
        contacts = next(cycle.contacts for cycle in skin if cycle.contacts)
    assert contacts[0].point("link").tolist() == contacts[0].point.tolist()
    for ask in (lambda: contacts[0].point("base"), lambda: skin.latest().joint_torques):
        with pytest.raises(LocalProtocolError, match=r"\[robot\]"):
            ask()
    with pytest.raises(ValueError, match="no frame 'bace'"):
        contacts[0].point("bace")
