"""`skinbus calibrate locate`: the table, the arm file when it is asked for, faults."""

import math
import re

import numpy as np
import pytest

from skinbus.cli.press_csv import write_presses
from skinbus.config.system import load_arm
from tests.cli.invoke import run
from tests.estimate.calibration.located_boards import made
from tests.files import put
from tests.robot.mesh_arms import write_tube

SEED = 20261202


def locate(*args, **settings):
    return run("calibrate", "locate", *args, **settings)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A file of an arm, presses on it, and the arm as it is."""
    folder = tmp_path_factory.mktemp("locate")
    planned, true, presses = made(folder, "cylinder", SEED)
    return folder / "cylinder.toml", planned, true, presses


@pytest.mark.slow
def test_places_go_into_the_file_when_it_is_asked_for(case, tmp_path):
    path, planned, true, presses = case
    own = put(tmp_path, "arm.toml", "# measured\n" + path.read_text())
    table = tmp_path / "presses.csv"
    write_presses(table, planned, presses)
    before = own.read_text()
    only = locate(own, table)
    assert own.read_text() == before
    assert only.count("±") == 60
    locate(own, table, "--write")
    assert own.read_text().startswith("# measured\n")
    after = load_arm(own)
    surface = after.links[0].surface
    off = surface.distance(after.patch_s, after.patch_a, true.patch_s, true.patch_a)
    assert math.sqrt(np.mean(off**2)) < 0.3e-3
    assert sorted(p.name for p in tmp_path.iterdir()) == ["arm.toml", "presses.csv"]


@pytest.mark.slow
def test_boards_at_each_others_places_are_not_moved_and_both_are_named_as_are_outliers(case, tmp_path):
    path, planned, _, presses = case
    swapped = [press._replace(patch={4: 13, 13: 4}.get(press.patch, press.patch)) for press in presses]
    swapped[7] = swapped[7]._replace(s=swapped[7].s + 9e-3)
    table = tmp_path / "presses.csv"
    write_presses(table, planned, swapped)
    result = locate(path, table, "--out", tmp_path / "out.toml", status=1)
    for node_id in (5, 14):
        said = rf"^node {node_id}: its presses fit \d+ mm from its place.* node_id in the presses"
        assert re.search(said, result, re.M)
    assert "line 9: more than 4 standard deviations off" in result
    assert "18 boards moved" in result
    old, new = load_arm(path, check_load=False), load_arm(tmp_path / "out.toml", check_load=False)
    assert [(new.patch_s[p], new.patch_a[p]) for p in (4, 13)] == [
        (old.patch_s[p], old.patch_a[p]) for p in (4, 13)
    ]


def test_boards_on_meshes_are_not_moved(tmp_path):
    """Nor by ``identify``: what places them are points, which neither command writes."""
    pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")
    arm = write_tube(tmp_path)
    put(tmp_path, "presses.csv", "node_id,s_mm,a_mm\n")
    for words in (
        ["calibrate", "locate", arm, tmp_path / "presses.csv", "--write"],
        ["scan", "identify", arm],
    ):
        assert "boards on meshes" in run(*words, status=2)
