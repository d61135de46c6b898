"""`skinbus presses`: a recording and the log of a robot, on clocks of their own, become presses."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import skinbus
from skinbus.cli import group
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError

SEED = 20261125
SHIFT_S = 17.25
N = 10
PLACE_MM, FORCE = 0.1, 0.01
"""Errors of what the robot and the force sensor say: mm, and a part."""


class Skin:
    """The cycles of a recording, as ``skinbus.replay`` gives them: what the pad reads under presses."""

    def __init__(self, truth, end_s):
        self.arm, self.truth, self.end_s = load_arm("pad"), truth, end_s

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        pass

    def __iter__(self):
        rng, arm = np.random.default_rng(SEED), self.arm
        for t in np.arange(0.0, self.end_s, 0.01):
            pressures = 100.0 * rng.standard_normal(arm.n_tactels)
            for begin, end, s, a, newton in self.truth:
                force = newton * np.clip(min(t - begin, end - t) / 0.03, 0.0, 1.0)
                d = np.hypot(arm.tactel_s - 1e-3 * s, arm.tactel_a - 1e-3 * a)
                pressures += arm.patches[0].patch.law.pressure(d, force)
            readings = SimpleNamespace(pressures=pressures, valid=np.ones(arm.n_tactels, bool))
            yield SimpleNamespace(t_ns=round(1e9 * t), readings=readings)


@pytest.fixture
def field(tmp_path, monkeypatch):
    """A recording of presses on the pad, what robot and force sensor logged, and the truth."""
    folder = tmp_path
    rng = np.random.default_rng(SEED)
    begin, truth = 1.0, []
    for _ in range(N):
        s, a, newton = rng.uniform(12.0, 38.0), rng.uniform(-13.0, 13.0), rng.uniform(4.0, 10.0)
        end = begin + rng.uniform(0.4, 0.6)
        truth.append((begin, end, s, a, newton))
        begin = end + rng.uniform(0.3, 0.5)
    monkeypatch.setattr(skinbus, "replay", lambda *words, **settings: Skin(truth, begin))
    (folder / "field.log").write_text("(0.0) can0 080#\n")
    t = np.arange(0.0, begin, 0.008)
    truth = np.array(truth)
    edges = np.sort(np.concatenate([truth[:, 0] - 0.03, truth[:, 1] + 0.03]))
    s, a = (np.interp(t, edges, np.repeat(truth[:, k], 2)) for k in (2, 3))
    pressing = np.clip(np.minimum(t[:, None] - truth[:, 0], truth[:, 1] - t[:, None]) / 0.03, 0.0, 1.0)
    force = (pressing * truth[:, 4]).sum(axis=1) * (1.0 + FORCE * rng.standard_normal())
    height = 20.0 * (pressing.sum(axis=1) == 0.0)
    offset = PLACE_MM * rng.standard_normal((2, 1))
    write(folder / "robot.csv", "t_s,s_mm,a_mm,height_mm", t + SHIFT_S, *(np.array([s, a]) + offset), height)
    write(folder / "xyz.csv", "t_s,x_mm,y_mm,z_mm", t + SHIFT_S, s, a, height)
    write(folder / "force.csv", "t_s,force_n", t - 3.0, force)
    return folder, truth


def write(path, head, *columns):
    np.savetxt(path, np.column_stack(columns), fmt="%.5f", delimiter=",", header=head, comments="")


def presses(folder, *words, out="out.csv"):
    args = [folder / "field.log", "--arm", "pad", *words, "--out", folder / out]
    return CliRunner().invoke(group, ["presses", *map(str, args)])


def found_in(folder, name="out.csv"):
    with (folder / name).open() as file:
        return [{k: float(v) if v else np.nan for k, v in row.items()} for row in csv.DictReader(file)]


@pytest.mark.parametrize("poses", ["robot.csv", "xyz.csv"])
def test_presses_are_joined_with_poses_and_forces_on_clocks_of_their_own(field, poses):
    folder, truth = field
    result = presses(folder, "--poses", folder / poses, "--force", folder / "force.csv")
    assert result.exit_code == 0, result.output
    assert "clock of the poses: -17." in result.output
    assert "clock of the forces: +" in result.output
    rows = found_in(folder)
    assert len(rows) == N
    for row, (_, _, s, a, newton) in zip(rows, truth, strict=True):
        assert np.hypot(row["s_mm"] - s, row["a_mm"] - a) < 0.4
        assert row["force_n"] == pytest.approx(newton, rel=0.05)
        assert row["p1"] == row["p1"]


def test_a_known_weight_takes_the_place_of_a_force_sensor(field):
    folder, _ = field
    result = presses(folder, "--poses", folder / "robot.csv", "--weight-n", "4.905")
    assert result.exit_code == 0, result.output
    assert {row["force_n"] for row in found_in(folder)} == {4.905}


def test_a_log_of_another_day_is_refused(field):
    folder, _ = field
    rng = np.random.default_rng(SEED)
    t = np.arange(0.0, 9.0, 0.01)
    walk = np.cumsum(rng.standard_normal((2, len(t))), axis=1)
    write(folder / "other.csv", "t_s,s_mm,a_mm", t, *walk)
    result = presses(folder, "--poses", folder / "other.csv", out="none.csv")
    assert result.exit_code == 1, result.output
    assert "no press" in result.output or "cannot be joined" in result.output
    assert not (folder / "none.csv").exists() or not (folder / "none.csv").read_text()


def test_every_fault_of_a_log_of_poses_is_said_at_once(field):
    folder, _ = field
    (folder / "bad.csv").write_text("t_s,s_mm,a_mm\n0,1,2\n0.1,x,2\n0.2,1\n")
    result = presses(folder, "--poses", folder / "bad.csv")
    assert isinstance(result.exception, ConfigError)
    assert "line 3, s_mm: is 'x'; wanted a number" in str(result.exception)
    assert "line 4: is '2 values'" in str(result.exception)
