"""`skinbus calibrate presses`: a recording and the log of a robot, on a clock of its own, become presses."""

import csv

import numpy as np
import pytest

from skinbus.cli.press_csv import write_presses
from skinbus.config.system import load_arm
from tests.cli.commands.pressed_field import make_field
from tests.cli.invoke import run
from tests.files import put
from tests.master.test_free_running import by_events

pytestmark = pytest.mark.slow

SEED = 20261125
N = 4


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """The folder of a field, and the truth."""
    folder = tmp_path_factory.mktemp("field")
    return folder, make_field(folder, N, SEED)


def presses(folder, *words, arm="pad"):
    args = [folder / "field.log", "--arm", arm, *words, "--out", folder / "out.csv"]
    return run("calibrate", "presses", *args)


def found_in(folder):
    with (folder / "out.csv").open() as file:
        return [{k: float(v) if v else np.nan for k, v in row.items()} for row in csv.DictReader(file)]


def check_places(rows, truth):
    assert len(rows) == N
    for row, (_, _, s, a, _) in zip(rows, truth, strict=True):
        assert np.hypot(row["s_mm"] - s, row["a_mm"] - a) < 0.4


def test_presses_are_joined_with_poses_and_forces_on_a_clock_of_their_own(field):
    folder, truth = field
    assert "clock of the poses: -17." in presses(folder, "--poses", folder / "robot.csv")
    rows = found_in(folder)
    check_places(rows, truth)
    for row, (*_, newton) in zip(rows, truth, strict=True):
        assert row["force_n"] == pytest.approx(newton, rel=0.05)
    # what the scene has, for a calibration to give single readings their due
    assert np.mean([row["n1"] for row in rows]) == pytest.approx(200.0, rel=0.2)


def test_presses_on_a_patch_that_sends_on_a_change_are_found_between_changes(tmp_path):
    arm = put(
        tmp_path,
        "free.toml",
        '[arm]\nname = "free"\nrate_hz = 5.0\n[[link]]\nname = "plate"\nsurface = "plane"\nlength_mm = 50.0\n'
        f'width_mm = 50.0\n[[patch]]\nnode_id = 1\nlink = "plate"\ns_mm = 25.0\nset = {by_events(2000)}\n',
    )
    truth = make_field(tmp_path, N, SEED, "free.toml", effects="")
    presses(tmp_path, "--poses", tmp_path / "robot.csv", arm=arm)
    check_places(found_in(tmp_path), truth)


def test_points_in_space_with_a_known_weight_or_three_lines_for_each_press_made_by_hand_are_enough(field):
    folder, truth = field
    lines = [
        f"{t:.1f},{s},{a},{newton}"
        for begin, end, s, a, _ in truth
        for t, newton in ((begin, 0), (0.5 * (begin + end), 4.905), (end, 0))
    ]
    put(folder, "hand.csv", "\n".join(["t_s,s_mm,a_mm,force_n", *lines]))
    for name, *words in (("xyz.csv", "--weight-n", "4.905"), ("hand.csv",)):
        presses(folder, "--poses", folder / name, *words)
        rows = found_in(folder)
        check_places(rows, truth)
        assert {row["force_n"] for row in rows} == {4.905}


def test_a_line_names_the_bus_where_an_arm_has_several(tmp_path):
    from skinbus.cli.commands.presses import felt  # it loads scipy.signal, which no other test needs

    arm = load_arm("arm-two-buses")
    means = np.zeros(arm.n_tactels)
    means[arm.tactels_of(arm.patch_at(1, 1))] = 900.0  # node 1 of the lower bus, on the elbow
    own = list(felt(arm, 1, (0.03, 0.0, np.nan), means, np.full_like(means, np.nan)))
    write_presses(tmp_path / "out.csv", arm, own)
    with (tmp_path / "out.csv").open() as file:
        (row,) = csv.reader(file.readlines()[1:])
    assert row[:5] == ["lower", "1", "30", "0", ""]
