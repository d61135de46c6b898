"""`skinbus board`: a board of one's own, on an arm of one's own."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from tests.cli.invoke import refused, run
from tests.files import put
from tests.objects.test_module_board import EIGHT_INPUTS

ARM = """
[arm]
name = "mine"

[[link]]
name = "forearm"
surface = "cylinder"
length_mm = 60.0
radius_mm = 50.0

[[ring]]
link = "forearm"
s_mm = 30.0
count = 6
first_node_id = 1
eds = {eds}
set = {{ "Thresholds/Touch Pa" = 1500 }}
"""


def board(*args):
    return run("board", *args)


@pytest.fixture
def eds(tmp_path):
    path = tmp_path / "my-board.eds"
    result = board("new", "--grid", "6x6", "--pitch-mm", "8", "--bits", "12", "--out", path)
    assert "36 tactels, 5 TPDOs of 8-bit readings" in result
    assert "16-bit readings of more than 32 tactels need a board on CAN FD: --canfd" in result
    return path


L_SHAPE = [(0, 0), (8, 0), (16, 0), (0, 8), (0, 16)]
"""Five tactels, mm; the middle of their extent is at 8, 8."""


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("u_mm,v_mm", "{},{}"),
        ("v_m,u_m", "{1}e-3,{0}e-3"),
        ("x_mm,y_mm,z_mm,nx,ny,nz", "{},{},5,0,0,1"),
        ("nx,ny,nz,x_m,y_m,z_m", "0,0,2,{}e-3,{}e-3,0.1"),
    ],
)
def test_tactels_lie_where_a_file_of_positions_says(tmp_path, header, line):
    positions, out = tmp_path / "tactels.csv", tmp_path / "l.eds"
    positions.write_text("\n".join([header, *(line.format(*place) for place in L_SHAPE)]))
    result = board("new", "--positions", positions, "--canfd", "--out", out)
    assert "8.0" in result  # the centre, in either form
    assert "5 tactels, 1 TPDO of 16-bit readings" in result
    patch = describe_patch(load_eds(out, 1))
    assert patch.tactels_uv == pytest.approx(1e-3 * (np.array(L_SHAPE) - 8.0), abs=1e-6)
    assert patch.diameter == pytest.approx(7e-3)


def test_a_new_board_passes_its_check_and_a_spoilt_one_is_refused_with_all_its_faults(eds):
    assert "no fault; 36 tactels on 49 x 49 mm, 5 TPDOs" in board("lint", eds)
    text = eds.read_text()
    eds.write_text(text.replace("$NODEID+0x40000280", "$NODEID+0x40000180", 1).replace("[1001]", "[1001sub]"))
    spoilt = refused("board", "lint", eds)
    assert "[1001]: wanted this object" in spoilt
    assert "0x40000180" in spoilt or "0x180" in spoilt


INPUTS = ("--pitch-mm", "10", "--full-scale-kpa", "500")


def test_an_analogue_module_of_others_becomes_a_board_of_an_arm(tmp_path):
    module, out = tmp_path / "module.eds", tmp_path / "inputs.dcf"
    module.write_text(EIGHT_INPUTS.read_text())
    adopted = board("new", "--grid", "4x2", *INPUTS, "--module", module, "--out", out)
    assert "8 tactels at the inputs of" in adopted
    checked = board("lint", out)
    assert "no fault; 8 tactels" in checked
    arm = load_arm(put(tmp_path, "arm.toml", ARM.partition("set =")[0].format(eds='"inputs.dcf"')))
    assert arm.n_tactels == 6 * 8
    assert arm.patches[0].patch.transducer.full_scale == 500e3
