"""A robot on the bus: from joint positions the master makes contacts in the base frame."""

import numpy as np
import pytest

from skinbus.can.core import NEVER, Core, Step
from skinbus.objects.contacts import ContactState
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import CONTACT, look_up_array
from tests.master.rig import MS, Rig
from tests.robot.two_joints import write

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")

CONTACT_MEMBERS = [v.name for v in look_up_array(load_eds("skin-master", 127), CONTACT)]


class Robot(Core):
    """Says at each SYNC where its first joint is."""

    cob_ids = frozenset({0x80})

    def __init__(self, rig):
        self.rig = rig
        self.is_silent = False
        rig.wire.attach(self)

    def step(self, now_ns, frames):
        if frames and not self.is_silent:
            self.rig.master.robot.offer(now_ns, {"first": self.angle(now_ns)})
        return Step((), (), NEVER)

    def angle(self, t_ns):
        return 1.0 * (1e-9 * t_ns - 0.5)  # 1 rad/s


@pytest.fixture
def robot(tmp_path):
    return Robot(Rig(str(write(tmp_path) / "scene.toml"), level="fit"))


@pytest.mark.slow
def test_the_record_and_the_objects_say_the_same(robot):
    robot.rig.run(1500)
    report, device = robot.rig.reports[-1], robot.rig.master.device
    placed = report.robot
    record = {name: device.get(0x3001, k) for k, name in enumerate(CONTACT_MEMBERS, 1)}
    assert record["Link and state"] >> 4 in (ContactState.TOUCH, ContactState.HELD)
    assert record["Robot valid"] == 1
    for name, frame in (("Base", 1), ("Tool", 2)):
        values = [record[f"{name} {axis}"] for axis in ("x", "y", "z", "nx", "ny", "nz", "fx", "fy", "fz")]
        force = -placed.force[0] * placed.normal[0, frame]
        expected = [*placed.point[0, frame], *placed.normal[0, frame], *force]
        np.testing.assert_allclose(values, expected, rtol=1e-6, atol=1e-9)
    covariance = [record[f"Base {entry}"] for entry in ("covariance x y", "variance z")]
    assert covariance == pytest.approx(placed.covariance[0, 1, [0, 2], [1, 2]], rel=1e-5)
    assert (device.get(0x2500, 1), device.get(0x2500, 2)) == (1, 2)
    np.testing.assert_allclose([device.get(0x2500, k) for k in range(3, 9)], placed.base_wrench, rtol=1e-5)
    for k in (1, 2):
        assert device.get(0x2501, k) == pytest.approx(placed.positions[k - 1], rel=1e-6)


def test_a_silent_controller_makes_the_base_invalid_not_wrong(robot):
    robot.rig.run(1000)
    robot.is_silent = True
    reports, _, _ = robot.rig.run(300)
    late = [report for report in reports if report.t_ns > 1100 * MS]
    assert late
    device = robot.rig.master.device
    for report in late:
        assert not report.robot.valid
        assert len(report.contacts) == 1
        assert np.isnan(report.robot.point[0, 1:]).all()
        np.testing.assert_allclose(report.robot.point[0, 0], [0.027, 0.003, 0.0], atol=2e-3)
    assert device.get(0x2500, 1) == device.get(0x3001, 0x3B) == 0
    assert device.get(0x2501, 1) == 0.0
    robot.is_silent = False
    reports, _, _ = robot.rig.run(200)
    assert reports[-1].robot.valid
