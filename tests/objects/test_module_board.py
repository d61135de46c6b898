"""An analogue module of others is a board: its DCF describes tactels, the master has it send them on SYNC."""

from pathlib import Path

import numpy as np
import pytest

from skinbus.model import grid
from skinbus.objects import cia
from skinbus.objects.dcf import configuration
from skinbus.objects.eds import load_eds
from skinbus.objects.new_board import HEARTBEAT_MS, NewBoard, module_dcf
from tests.files import put
from tests.master.rig import Rig

EIGHT_INPUTS = Path(__file__).parent / "data" / "eight-inputs.eds"
FULL_SCALE_PA = 500_000


def board(columns=4, rows=2):
    return NewBoard(
        name="inputs.dcf",
        tactels_uv=grid(columns, rows, 10e-3),
        pitch=10e-3,
        bits=16,
        full_scale_pa=FULL_SCALE_PA,
    )


@pytest.fixture
def dcf(tmp_path):
    return put(tmp_path, "inputs.dcf", module_dcf(EIGHT_INPUTS.read_text(), board()))


def test_the_module_is_given_only_what_it_has(dcf):
    writes = configuration(load_eds(dcf, 7)).writes
    told = {(write.index, write.sub): int.from_bytes(write.data, "little") for write in writes}
    assert max(index for index, _ in told) < 0x2000
    assert told[cia.HEARTBEAT_PRODUCER, 0] == HEARTBEAT_MS
    for k in range(4):
        assert told[cia.TPDO_COMMUNICATION + k, cia.PDO_TYPE] == 1
        assert told[cia.TPDO_COMMUNICATION + k, cia.PDO_INHIBIT] == 0


ARM = """
[arm]
name = "module"

[[link]]
name = "plate"
surface = "plane"
length_mm = 60.0
width_mm = 60.0

[[patch]]
node_id = 3
link = "plate"
s_mm = 30.0
eds = "inputs.dcf"
"""
SCENE = """
[scene]
arm = "arm.toml"
duration_s = 10.0

[effect.noise]

[[touch]]
link = "plate"
s_mm = 32.0
a_mm = 3.0
force_n = 8.0
start_s = 2.0
end_s = 9.0
"""


@pytest.mark.slow
def test_a_simulated_module_makes_contacts(dcf, tmp_path):
    put(tmp_path, "arm.toml", ARM)
    rig = Rig(put(tmp_path, "scene.toml", SCENE))
    reports, *_ = rig.run(4000)
    contacts = reports[-1].contacts
    assert len(contacts) == 1
    sd = np.sqrt(np.diag(contacts.covariance[0]))
    away = np.array([contacts.s[0] - 32e-3, contacts.a[0] - 3e-3, contacts.force[0] - 8.0])
    assert (abs(away) < 6.0 * sd).all()
