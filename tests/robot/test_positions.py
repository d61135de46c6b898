"""Joint positions at the time of a SYNC: exact for even motion, uncertain by acceleration, or withheld."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skinbus.errors import ArgumentError
from skinbus.model import JointSettings, RobotSettings
from skinbus.robot.positions import JointPositions

MS = 1_000_000


def put(joints, t_ns, positions):
    """Give positions of a time."""
    joints.put(t_ns, joints.resolve(positions))


def positions(kinds=("revolute", "prismatic", "continuous"), *joints, velocity=math.inf):
    names = tuple(f"j{k}" for k in range(len(kinds)))
    chain = SimpleNamespace(names=names, kinds=kinds, velocity=np.full(len(kinds), velocity))
    settings = RobotSettings(file="", urdf="", max_age_ns=50 * MS, links=(), joints=tuple(joints))
    return JointPositions(chain, settings)


def test_even_motion_is_exact_between_positions_and_after_the_newest():
    joints = positions()
    rate = np.array([1.0, 0.2, -2.0])
    for ms in (0, 20, 40):
        put(joints, ms * MS, 0.3 + rate * ms / 1e3)
    for ms in (1, 19, 20, 33, 40, 55, 90):
        q, sd = joints.at(ms * MS)
        assert_allclose(q, 0.3 + rate * ms / 1e3, atol=1e-12)
        assert_allclose(sd, 0.0, atol=1e-12)


def test_what_acceleration_does_is_within_the_standard_deviation():
    joints = positions(("revolute",), JointSettings(name="j0", sd=1e-4))

    def truth(ms):
        return 5.0 * (ms / 1e3) ** 2  # 10 rad/s^2

    for ms in (0, 20, 40):
        put(joints, ms * MS, [truth(ms)])
    for ms in (5, 30, 45, 60):
        q, sd = joints.at(ms * MS)
        assert_allclose(sd[0], math.hypot(q[0] - truth(ms), 1e-4), rtol=1e-6)


def test_positions_that_are_old_or_too_few_are_withheld():
    joints = positions(("revolute",))
    assert joints.at(0) is None
    for ms in (0, 20, 40):
        assert joints.at(ms * MS) is None  # until three have come: how it moves is not known before
        put(joints, ms * MS, [0.5])
    assert joints.at(90 * MS) is not None
    assert joints.at(91 * MS) is None
    assert joints.at(-1) is None
    put(joints, 200 * MS, [0.5])  # after a gap, nothing is known of what happened in it
    assert joints.at(199 * MS) is None
    assert joints.at(201 * MS) is None
    put(joints, 220 * MS, [0.5])
    assert joints.at(221 * MS) is None
    put(joints, 240 * MS, [0.5])
    assert joints.at(240 * MS) is not None


def test_with_a_limit_of_velocity_one_position_is_enough_and_says_how_far_it_may_be_off():
    joints = positions(("revolute",), JointSettings(name="j0", sd=0.01), velocity=2.0)
    put(joints, 0, [0.5])
    for ms in (0, 20, 50):
        q, sd = joints.at(ms * MS)
        assert q[0] == 0.5
        assert sd[0] == pytest.approx(math.hypot(0.01, 2.0 * ms / 1e3))
    assert joints.at(51 * MS) is None
    put(joints, 40 * MS, [0.54])
    for ms, off in ((10, 10), (30, 10), (60, 20)):
        q, sd = joints.at(ms * MS)
        assert q[0] == pytest.approx(0.5 + 1e-3 * ms)
        assert sd[0] == pytest.approx(math.hypot(0.01, 2.0 * off / 1e3))


def test_a_fixed_joint_is_always_known():
    joints = positions(("revolute", "prismatic"), JointSettings(name="j0", fixed=0.7, sd=0.01))
    assert joints.from_python == ("j1",)
    for ms in (0, 20, 40):
        put(joints, ms * MS, {"j1": 0.1})
    q, sd = joints.at(50 * MS)
    assert_allclose(q, [0.7, 0.1])
    assert_allclose(sd, [0.01, 0.0], atol=1e-15)
    q, _ = positions(("revolute",), JointSettings(name="j0", fixed=0.7)).at(0)
    assert_array_equal(q, [0.7])


def test_a_joint_that_is_not_named_stays_where_it_was_until_that_is_too_old():
    joints = positions(("revolute", "revolute"))
    for ms in (0, 20, 40):
        put(joints, ms * MS, [0.3, 0.4])
    for ms in (60, 80):
        put(joints, ms * MS, {"j1": 0.4})
    assert_array_equal(joints.at(80 * MS)[0], [0.3, 0.4])
    put(joints, 100 * MS, {"j1": 0.4})
    assert joints.at(100 * MS) is None


def test_a_continuous_joint_goes_the_short_way_round():
    joints = positions(("continuous",))
    for ms, angle in ((0, 3.0), (20, 3.1), (40, 3.2 - 2 * math.pi)):
        put(joints, ms * MS, [angle])
    q, sd = joints.at(30 * MS)
    assert q[0] == pytest.approx(3.15)
    assert sd[0] < 1e-9


def test_what_cannot_be_is_refused_and_changes_nothing():
    joints = positions(("revolute", "revolute"), JointSettings(name="j1", fixed=1.0))
    for bad, why in (
        ([1.0, 2.0], r"wanted \(1,\)"),
        ({"j1": 0.0}, "no joint 'j1' to be set; wanted j0"),
        ([math.nan], "finite"),
        (np.ma.masked_array([1.0], [True]), "finite"),
        (["up"], "numbers"),
        ([[1.0], [1.0, 2.0]], "numbers"),
    ):
        with pytest.raises(ArgumentError, match=why):
            put(joints, 0, bad)
    for ms in (0, 20, 40):
        put(joints, ms * MS, [0.0])
    assert_array_equal(joints.at(40 * MS)[0], [0.0, 1.0])
