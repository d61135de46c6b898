"""Contacts on a robot agree with Pinocchio, and uncertainties with finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag

from skinbus.robot import RobotFrames
from tests.files import put
from tests.robot.robots import URDF, arm_on, columns_on, pinocchio, random_urdf

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")

EXACT = 1e-9
"""m, and N m for forces of some newtons: rounding over a dozen joints is 1e-14."""


def assert_agrees_with_pinocchio(pin, urdf_text, arm, rng):
    model = pin.buildModelFromXML(urdf_text)
    data = model.createData()
    frames = RobotFrames(arm)
    chain = frames.chain
    q = rng.uniform(-2.5, 2.5, chain.n_joints)
    everywhere = pin.neutral(model)
    columns = []
    for j, name in enumerate(chain.names):
        joint = model.joints[model.getJointId(name)]
        columns.append(joint.idx_v)
        if joint.nq == 2:
            everywhere[joint.idx_q : joint.idx_q + 2] = np.cos(q[j]), np.sin(q[j])
        else:
            everywhere[joint.idx_q] = q[j]
    pin.framesForwardKinematics(model, data, everywhere)
    pin.computeJointJacobians(model, data, everywhere)
    contacts = columns_on(arm, rng)
    placed = frames.place(contacts, q)
    torques, wrench = np.zeros(model.nv), np.zeros(6)
    tool = data.oMf[model.getFrameId(arm.robot.tool)]
    for c, k in enumerate(contacts.link):
        on = arm.robot.links[k]
        number, X_LS = model.getFrameId(on.name), pin.SE3(on.X_LS)
        X_BL = data.oMf[number]
        point, normal = arm.links[k].surface.position(contacts.s[c], contacts.a[c])
        point_L, normal_L = X_LS.act(point), X_LS.rotation @ normal
        point, normal = X_BL.act(point_L), X_BL.rotation @ normal_L
        points = [point_L, point, tool.actInv(point)]
        assert_allclose(placed.point[c], points, atol=EXACT)
        assert_allclose(placed.normal[c], [normal_L, normal, tool.rotation.T @ normal], atol=EXACT)
        jacobian = np.zeros((6, 0))
        if model.nv:  # a model without a joint ends the process
            aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            jacobian = pin.getFrameJacobian(model, data, number, aligned)
        jacobian = np.reshape(jacobian, (6, model.nv)).copy()  # one joint alone comes as a row
        jacobian[:3] += np.cross(jacobian[3:], point - X_BL.translation, axisa=0).T
        assert_allclose(placed.jacobian[c], jacobian[:, columns], atol=EXACT)
        others = np.delete(jacobian, columns, axis=1)
        assert_array_equal(others, 0.0)  # what is left out moves no skin
        force = -contacts.force[c] * normal
        torques += jacobian[:3].T @ force
        wrench += np.concatenate([force, np.cross(point, force)])
    assert_allclose(placed.torques, torques[columns], atol=EXACT)
    assert_allclose(placed.base_wrench, wrench, atol=EXACT)


@pytest.mark.parametrize("robot", ["ur5e", "ur10e"])
def test_real_arms_agree_with_pinocchio(robot):
    pin = pinocchio()
    path = URDF / f"{robot}.urdf"
    rng = np.random.default_rng(5)
    names = ["shoulder_link", "upper_arm_link", "forearm_link", "wrist_2_link", "tool0"]
    for _ in range(20):
        arm = arm_on(path, names, rng, base="base_link", tool="tool0")
        assert_agrees_with_pinocchio(pin, path.read_text(), arm, rng)


@pytest.mark.slow
def test_two_hundred_random_trees_agree_with_pinocchio(tmp_path):
    pin = pinocchio()
    path = tmp_path / "random.urdf"
    for seed in range(200):
        rng = np.random.default_rng(seed)
        text, n = random_urdf(rng)
        path.write_text(text)
        names = [f"link{k}" for k in rng.integers(0, n + 1, 3)]
        arm = arm_on(path, names, rng, base="link0", tool=f"link{rng.integers(0, n + 1)}")
        assert_agrees_with_pinocchio(pin, text, arm, rng)


@pytest.mark.parametrize("seed", range(5))
def test_covariances_are_those_of_finite_differences(seed, tmp_path):
    """Of points in all frames, by places and joints, on trees of all kinds."""
    rng = np.random.default_rng(seed)
    text, n = random_urdf(rng)
    path = put(tmp_path, "random.urdf", text)
    names = [f"link{k}" for k in rng.integers(0, n + 1, 3)]
    arm = arm_on(path, names, rng, tool=f"link{rng.integers(0, n + 1)}")
    frames = RobotFrames(arm)
    q, sd = rng.uniform(-2.0, 2.0, frames.chain.n_joints), rng.uniform(0.0, 0.02, frames.chain.n_joints)
    contacts = columns_on(arm, rng, 3)

    def points(moved):
        """Points of the contacts where all places, in s and a, and the joints have moved."""
        there = replace(contacts, s=contacts.s + moved[0], a=contacts.a + moved[1])
        return frames.place(there, q + moved[2:]).point

    step = 1e-6
    slopes = [(points(d) - points(-d)) / (2 * step) for d in step * np.eye(2 + len(q))]
    slopes = np.stack(slopes, -1)  # (contacts, frames, 3, moves)
    given = np.stack([block_diag(cov[:2, :2], np.diag(sd**2)) for cov in contacts.covariance])[:, None]
    expected = slopes @ given @ slopes.swapaxes(2, 3)
    assert_allclose(frames.place(contacts, q, sd).covariance, expected, rtol=1e-6, atol=1e-12)
