"""`skinbus calibrate`: presses in a CSV file become a DCF that an arm file takes."""

import csv

import numpy as np
import pytest
from click.testing import CliRunner

from skinbus.cli import group
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError
from skinbus.model import Radial
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds

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
LAW = Radial(400e-6, 13000.0 * np.exp(-((np.arange(64) / 20.0) ** 2)), 0.9)


@pytest.fixture
def arm_file(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM.format(three="skin-patch"))
    return path


def write_presses(path, arm, *, zero=0, with_force=True, force=None, n=300):
    """Write what both patches read under presses; return the gains put in."""
    rng = np.random.default_rng(8)
    gain = 1.0 + 0.03 * rng.standard_normal(arm.n_tactels)
    step = arm.patches[0].patch.transducer.step
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "node_id", "s_mm", "a_mm", "force_n", *(f"c{k + 1}" for k in range(16))])
        for k in range(n):
            s, a = rng.uniform(0.0, 0.101), rng.uniform(-0.03, 0.03)
            newton = 0.0 if zero and k < 20 else force or rng.uniform(2.0, 10.0)
            d = np.hypot(arm.tactel_s - s, arm.tactel_a - a)
            p = LAW.pressure(d, newton) / gain if newton else np.zeros(arm.n_tactels)
            counts = np.rint((p + 50.0 * rng.standard_normal(arm.n_tactels)) / step).astype(int) + zero
            for patch in range(2):
                row = counts[arm.tactels_of(patch)].tolist()
                told = f"{newton:.4f}" if with_force or not newton else ""
                writer.writerow([0.1 * k, 3 + patch, 1e3 * s, 1e3 * a, told, *row])
    return gain


def run(*args):
    return CliRunner().invoke(group, ["calibrate", *map(str, args)])


def profile_error(law, scale=1.0):
    d = np.linspace(0.0, 0.02, 100)
    return np.abs(law.profile(d) * scale - LAW.profile(d)).max() / LAW.table[0]


@pytest.mark.parametrize("zero", [0, 400])
def test_presses_become_files_that_an_arm_file_takes(arm_file, tmp_path, zero):
    gain = write_presses(tmp_path / "presses.csv", load_arm(arm_file), zero=zero)
    result = run(
        arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf", "--picture", tmp_path / "p"
    )
    assert result.exit_code == 0, result.output
    assert "converged" in result.output
    assert (tmp_path / "p" / "calibration.svg").exists()
    for node_id, own in ((3, gain[:16]), (4, gain[16:])):
        patch = describe_patch(load_eds(tmp_path / f"mine-{node_id}.dcf", node_id))
        assert profile_error(patch.law) < 0.02
        assert patch.law.exponent == pytest.approx(0.9, abs=0.01)
        np.testing.assert_allclose(patch.gain / gain.mean(), own / gain.mean() ** 2, rtol=0.01)
        assert np.median(patch.noise) == pytest.approx(50.0, rel=0.15)
    arm_file.write_text(ARM.format(three="mine-3.dcf"))
    assert isinstance(load_arm(arm_file).patches[0].patch.law, Radial)


def test_force_that_is_not_known_gives_the_law_up_to_it(arm_file, tmp_path):
    write_presses(tmp_path / "presses.csv", load_arm(arm_file), with_force=False, force=5.0)
    result = run(arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf")
    assert result.exit_code == 0, result.output
    assert "not known" in result.output
    law = describe_patch(load_eds(tmp_path / "mine-3.dcf", 3)).law
    assert profile_error(law, 1.0 / 5.0**0.9) < 0.02


def test_every_fault_of_a_file_is_said_at_once_and_nothing_is_written(arm_file, tmp_path):
    path = tmp_path / "presses.csv"
    path.write_text(
        "node_id,s_mm,a_mm,force_n,c1,c2\n"
        "3,10,zero,5,100,200\n"
        "9,10,0,5,100,200\n"
        "3,,0,-1,100,200\n"
        "3,10,0,,1O0,200\n"
        "3,10,0,5,,\n"
        "3,10,0,5,1,2,3\n"
        "3,10,0,5,1,2\n"
        "4,10,0,,1,2\n"
    )
    result = run(arm_file, path, "--out", tmp_path / "mine.dcf")
    assert isinstance(result.exception, ConfigError)
    said = str(result.exception)
    for words in (
        "line 2, a_mm: is 'zero'; wanted a number",
        "line 3, node_id: is '9'; wanted a patch of the arm",
        "line 4, s_mm: wanted a number",
        "line 4, force_n: is -1.0; wanted a positive number",
        "line 5, c1: is '1O0'; wanted a number",
        "line 6: is 'no reading'; wanted some of c1 to c16",
        "line 7: is 'more values than columns'",
        "force_n: is 'empty in 1 of 2 presses'",
    ):
        assert words in said, said
    assert not list(tmp_path.glob("*.dcf"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "columns node_id, s_mm, a_mm"),
        ("node_id,s_mm,force_n\n", "columns node_id, s_mm, a_mm"),
        ("node_id,s_mm,a_mm,c1\n", "wanted presses"),
        ("node_id,s_mm,a_mm,c1\n3,10,0,5\n", "usable readings"),
    ],
)
def test_file_that_cannot_be_learned_from_says_why(arm_file, tmp_path, text, words):
    (tmp_path / "presses.csv").write_text(text)
    result = run(arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf")
    assert isinstance(result.exception, ConfigError)
    assert words in str(result.exception)
