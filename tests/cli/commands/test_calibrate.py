"""`skinbus calibrate`: presses in a CSV file become a DCF that an arm file takes."""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from skinbus.cli import group
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError
from skinbus.estimate.calibration.table import kind_of
from skinbus.model import Arm, Radial
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


def write_presses(path, arm, *, zero=0, with_force=True, force=None, n=130, around=None):
    """Write what both patches read under presses; return the gains put in."""
    rng = np.random.default_rng(8)
    gain = 1.0 + 0.03 * rng.standard_normal(arm.n_tactels)
    step = arm.patches[0].patch.transducer.step
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "node_id", "s_mm", "a_mm", "force_n", *(f"c{k + 1}" for k in range(16))])
        for k in range(n):
            s, a = rng.uniform(0.0, 0.101), rng.uniform(-0.03, 0.03)
            if around:
                s, a = 0.6 * s, rng.uniform(-0.5, 0.5) * around
            newton = 0.0 if zero and k < 10 else force or rng.uniform(2.0, 10.0)
            d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, s, a)
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


@pytest.mark.slow
def test_presses_become_files_that_an_arm_file_takes(arm_file, tmp_path):
    gain = write_presses(tmp_path / "presses.csv", load_arm(arm_file), zero=400, n=300)
    result = run(arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf")
    assert result.exit_code == 0, result.output
    assert "converged" in result.output
    for node_id, own in ((3, gain[:16]), (4, gain[16:])):
        patch = describe_patch(load_eds(tmp_path / f"mine-{node_id}.dcf", node_id))
        assert profile_error(patch.law) < 0.02
        assert patch.law.exponent == pytest.approx(0.9, abs=0.01)
        np.testing.assert_allclose(patch.gain / gain.mean(), own / gain.mean() ** 2, rtol=0.01)
        assert np.median(patch.noise) == pytest.approx(50.0, rel=0.15)
    arm_file.write_text(ARM.format(three="mine-3.dcf"))
    assert isinstance(load_arm(arm_file).patches[0].patch.law, Radial)


@pytest.mark.slow
def test_force_that_is_not_known_gives_the_law_up_to_it(arm_file, tmp_path):
    write_presses(tmp_path / "presses.csv", load_arm(arm_file), with_force=False, force=5.0)
    result = run(arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf")
    assert result.exit_code == 0, result.output
    assert "not known" in result.output
    assert "at the peak of these presses" in result.output
    assert "forces will not be in newtons" in result.output
    assert "known forces (`force_n`)" in result.output
    law = describe_patch(load_eds(tmp_path / "mine-3.dcf", 3)).law
    assert profile_error(law, 1.0 / 5.0**0.9) < 0.02


def test_every_fault_of_a_file_is_said_at_once_and_nothing_is_written(arm_file, tmp_path):
    path = tmp_path / "presses.csv"
    path.write_text(
        "node_id,s_mm,a_mm,force_n,c1,c2\n"
        "3,10,zero,5,100,200\n"
        "9,10,0,5,100,200\n"
        "3,,0,1,100,200\n"
        "3,10,0,,1O0,200\n"
        "3,10,0,5,,\n"
        "3,10,0,5,1,2,3\n"
        "3,10,0,5,1,2\n"
        "4,10,0,,1,2\n"
        "3,10,0,-1,100,200\n"
    )
    result = run(arm_file, path, "--out", tmp_path / "mine.dcf")
    assert isinstance(result.exception, ConfigError)
    said = str(result.exception)
    for words in (
        "line 2, a_mm: is 'zero'; wanted a number",
        "line 3, node_id: is '9'; wanted a patch of the arm",
        "line 4, s_mm: wanted a number",
        "line 10, force_n: is -1.0; wanted a positive number",
        "line 5, c1: is '1O0'; wanted a number",
        "line 6: is 'no reading'; wanted some of c1 to c16",
        "line 7: is '7 values'; wanted 6 values, as in line 1",
        "force_n: is 'empty in 1 of 5 presses'",
    ):
        assert words in said, said
    assert not list(tmp_path.glob("*.dcf"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "columns node_id, s_mm, a_mm"),
        ("node_id,s_mm,force_n\n", "missing: a_mm, c1"),
        (
            "Node,s [mm],a,F,P1\n",
            "missing: node_id (is it 'Node'?), s_mm (is it 's [mm]'?), a_mm (is it 'a'?), p1 (is it 'P1'?)",
        ),
        ("node_id,s_mm,a_mm,force,c1\n", "is 'force'; wanted column 'force_n', or another name"),
        ("node_id,s_mm,a_mm,c1\n", "wanted presses"),
        ("node_id;s_mm;a_mm;c1\n3;10,5;0;5\n", "divided by ';'\"; wanted commas between columns"),
        ("node_id\ts_mm\ta_mm\tc1\n", "wanted commas between columns"),
    ],
)
def test_file_that_cannot_be_learned_from_says_why(arm_file, tmp_path, text, words):
    (tmp_path / "presses.csv").write_text(text)
    result = run(arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf")
    assert isinstance(result.exception, ConfigError)
    assert words in str(result.exception)


def test_what_places_cannot_be_is_refused_and_named_and_nothing_is_written(arm_file, tmp_path):
    write_presses(tmp_path / "good.csv", load_arm(arm_file), n=120)
    with (tmp_path / "good.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row["s_mm"], row["a_mm"] = row["a_mm"], row["s_mm"]
    with (tmp_path / "swapped.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    result = run(arm_file, tmp_path / "swapped.csv", "--out", tmp_path / "mine.dcf")
    assert result.exit_code == 1, result.output
    assert "with s and a swapped they do" in result.output
    assert "nothing is written" in result.output
    assert not list(tmp_path.glob("*.dcf"))


def test_too_few_presses_are_refused_and_written_only_by_force(arm_file, tmp_path):
    write_presses(tmp_path / "presses.csv", load_arm(arm_file), n=20)
    page = tmp_path / "report.html"
    result = run(arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf", "--report", page)
    assert result.exit_code == 1
    assert "too few" in result.output
    assert "tactels, refused" in page.read_text()
    assert not list(tmp_path.glob("*.dcf"))
    result = run(arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf", "--force")
    assert result.exit_code == 0, result.output
    assert len(list(tmp_path.glob("*.dcf"))) == 2


@pytest.mark.slow
def test_wrong_lines_are_left_out_and_listed_with_their_numbers_and_on_the_page(arm_file, tmp_path):
    write_presses(tmp_path / "presses.csv", load_arm(arm_file), n=120)
    lines = (tmp_path / "presses.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines[1:]]
    on_three = [k for k, c in enumerate(cells) if c[1] == "3" and 10 < float(c[2]) < 40][:3]
    for k in on_three:
        cells[k][3] = f"{float(cells[k][3]) + (15.0 if float(cells[k][3]) < 0.0 else -15.0):.3f}"
    (tmp_path / "presses.csv").write_text("\n".join([lines[0], *(",".join(c) for c in cells)]) + "\n")
    page = tmp_path / "report.html"
    result = run(arm_file, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf", "--report", page)
    assert result.exit_code == 0, result.output
    listed = next(line for line in result.output.splitlines() if "left out" in line)
    shown = page.read_text()
    for k in on_three:
        assert str(k + 2) in listed
        assert f"<tr><td>{k + 2}</td><td>3</td>" in shown
    expected = re.search(r"error to expect .*?: ([\d.]+) mm", result.output)[1]
    assert f"{expected} mm" in shown
    assert not re.search(r"src\s*=|href=\"[^#]|url\([^#]|@import", shown)  # it fetches nothing
    assert shown.count("errors, 10 times as long") == 2  # one for each board


@pytest.mark.slow
def test_ring_takes_a_list_and_boards_that_were_not_pressed_the_law(tmp_path):
    path = tmp_path / "ring.toml"
    path.write_text(
        "[arm]\nname = 'r'\n[[link]]\nname = 'tube'\nsurface = 'cylinder'\n"
        "length_mm = 60.0\nradius_mm = 26.0\n"
        "[[ring]]\nlink = 'tube'\ns_mm = 30.0\ncount = 3\nfirst_node_id = 3\n"
    )
    arm = load_arm(path)
    write_presses(tmp_path / "presses.csv", arm, n=240, around=arm.links[0].surface.period)
    result = run(path, tmp_path / "presses.csv", "--out", tmp_path / "mine.dcf", "--all-of-kind")
    assert result.exit_code == 0, result.output
    line = next(line for line in result.output.splitlines() if line.startswith("ring[1]: eds = "))
    files = [tmp_path / f"mine-{node_id}.dcf" for node_id in (3, 4, 5)]
    assert all(str(file) in line for file in files)
    laws = [describe_patch(load_eds(file, k + 3)) for k, file in enumerate(files)]
    assert profile_error(laws[2].law) < 0.02
    np.testing.assert_array_equal(laws[2].gain, 1.0)
    assert np.std(laws[0].gain) > 0.01
    path.write_text(path.read_text() + line.partition(": ")[2].partition(" in that")[0] + "\n")
    assert isinstance(load_arm(path).patches[1].patch.law, Radial)


def test_a_mirrored_board_is_of_the_kind_of_the_others():
    arm = load_arm("pad")
    (placed,) = arm.patches
    mirrored = replace(placed, patch=placed.patch.mirrored(), node_id=2, s=placed.s + 0.06)
    both = Arm(arm.name, arm.links, [placed, mirrored], *arm.buses)
    assert kind_of(both, 0) == kind_of(both, 1)
