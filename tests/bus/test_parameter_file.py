"""Parameters in a file: over a power cycle, damaged, write-protected."""

import pytest

from skinbus.bus.parameter_file import ParameterFile
from tests.node.node_table import Bench, writes
from tests.node.rows_storage import SAVE

STEPS = [*writes("1015:00", "64 00"), *writes("1010:01", SAVE)]


def feed(bench, steps):
    for step in steps:
        if step.startswith("->"):
            bench.step([bench.frame(step.partition(";")[0][3:])])
    return bench


def test_parameters_survive_a_power_cycle(tmp_path):
    file = ParameterFile(tmp_path / "node5.json")
    bench = feed(Bench("patch", storage=file), STEPS)
    bench.power()
    assert bench.device.get(0x1015) == 100
    assert [path.name for path in tmp_path.iterdir()] == ["node5.json"]


def test_groups_are_kept_apart(tmp_path):
    file = ParameterFile(tmp_path / "f")
    assert file.load("a") is None
    file.save("a", "1")
    file.save("b", "2\n")
    file.erase("a")
    file.erase("a")
    assert (file.load("a"), file.load("b")) == (None, "2\n")


@pytest.mark.parametrize(
    "content", ["", "{", "[]", '{"communication": 1}', '{"communication": "x"}', "\udc80"]
)
def test_file_that_is_damaged_is_an_error_and_the_defaults_hold(tmp_path, content):
    path = tmp_path / "f"
    path.write_bytes(content.encode(errors="surrogateescape"))
    bench = Bench("patch", storage=ParameterFile(path), state="off")
    bench.step()
    assert bench.device.get(0x1015) == 0
    assert bench.sent[-1].data == bytes.fromhex("0063010000000000")
    assert "storage" in [event.kind for event in bench.events]


def test_folder_that_is_not_there_is_an_abort(tmp_path):
    bench = feed(Bench("patch", storage=ParameterFile(tmp_path / "no" / "f")), STEPS)
    assert bench.sent[-1].data[4:] == bytes.fromhex("00000606")


def test_saving_mends_a_damaged_file(tmp_path):
    path = tmp_path / "f"
    path.write_text("{")
    bench = Bench("patch", storage=ParameterFile(path), state="off")
    bench.step()
    feed(bench, STEPS)
    assert bench.sent[-1].data[0] == 0x60
    bench.power()
    assert bench.device.get(0x1015) == 100
