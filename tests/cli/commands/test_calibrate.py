"""`skinbus calibrate`: presses in a CSV file become a DCF that an arm file takes."""

from dataclasses import replace

import numpy as np
import pytest

from skinbus.cli import press_csv
from skinbus.config.system import load_arm
from skinbus.estimate.calibration.table import Press, kind_of
from skinbus.model import Arm, Radial
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from tests.cli.invoke import run
from tests.files import put

ARM = """
[arm]
name = "two"
[[link]]
name = "plate"
surface = "plane"
length_mm = 110.0
width_mm = 60.0
[[patch]]
node_id = 3
link = "plate"
s_mm = 25.0
eds = "{three}"
[[patch]]
node_id = 4
link = "plate"
s_mm = 76.0
"""
NOISE = 50.0
LAW = Radial(400e-6, 13000.0 * np.exp(-((np.arange(64) / 20.0) ** 2)), 0.9)


@pytest.fixture
def arm_file(tmp_path):
    return put(tmp_path, "arm.toml", ARM.format(three="skin-patch"))


def write_presses(path, arm, n, zero=0):
    """Write what both patches read; with a zero the first ten presses are none. Return the gains put in."""
    rng, step, presses = np.random.default_rng(8), arm.patches[0].patch.transducer.step, []
    gain = 1.0 + 0.03 * rng.standard_normal(arm.n_tactels)
    for k in range(n):
        s, a = rng.uniform(0.0, 0.101), rng.uniform(-0.03, 0.03)
        newton = 0.0 if zero and k < 10 else rng.uniform(2.0, 10.0)
        p = LAW.pressure(arm.distance(slice(None), s, a), max(newton, 1e-9)) / gain * (newton > 0.0)
        counts = np.rint((p + NOISE * rng.standard_normal(arm.n_tactels)) / step) + zero
        for patch in range(2):
            readings = step * counts[arm.tactels_of(patch)]
            presses.append(Press(patch, s, a, newton, readings, noise=np.full(16, NOISE)))
    press_csv.write_presses(path, arm, presses)
    return gain


def profile_error(law):
    d = np.linspace(0.0, 0.02, 100)
    return np.abs(law.profile(d) - LAW.profile(d)).max() / LAW.table[0]


@pytest.mark.slow
def test_presses_become_files_that_an_arm_file_takes(arm_file, tmp_path):
    gain = write_presses(tmp_path / "presses.csv", load_arm(arm_file), zero=400, n=300)
    result = run("calibrate", arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf")
    assert "converged" in result
    for node_id, own in ((3, gain[:16]), (4, gain[16:])):
        patch = describe_patch(load_eds(tmp_path / f"mine-{node_id}.dcf", node_id))
        assert profile_error(patch.law) < 0.02
        assert patch.law.exponent == pytest.approx(0.9, abs=0.01)
        np.testing.assert_allclose(patch.gain / gain.mean(), own / gain.mean() ** 2, rtol=0.01)
        assert np.median(patch.noise) == pytest.approx(NOISE, rel=0.15)
    arm_file.write_text(ARM.format(three="mine-3.dcf"))
    assert isinstance(load_arm(arm_file).patches[0].patch.law, Radial)


@pytest.mark.slow
def test_too_few_presses_are_refused_and_written_only_by_force(arm_file, tmp_path):
    write_presses(tmp_path / "presses.csv", load_arm(arm_file), n=20)
    result = run("calibrate", arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf", status=1)
    assert "too few" in result
    assert not list(tmp_path.glob("*.dcf"))
    result = run("calibrate", arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf", "--force")
    assert len(list(tmp_path.glob("*.dcf"))) == 2


def test_a_mirrored_board_is_of_the_kind_of_the_others():
    arm = load_arm("pad")
    (placed,) = arm.patches
    mirrored = replace(placed, patch=placed.patch.mirrored(), node_id=2, s=placed.s + 0.06)
    both = Arm(arm.name, arm.links, [placed, mirrored], *arm.buses)
    assert kind_of(both, 0) == kind_of(both, 1)
