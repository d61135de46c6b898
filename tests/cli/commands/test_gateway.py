"""`skinbus gateway`: words that would do harm on a bus."""

from click.testing import CliRunner

from skinbus.cli import group
from tests.gateway.doubles import write_scene


def test_skin_on_the_bus_of_its_patches_is_refused(tmp_path):
    write_scene(tmp_path, ["2.0"], 5, 2)
    words = ["gateway", "icub-mtb4", str(tmp_path / "plate.toml"), "--from", "can0", "--to", "can0"]
    answer = CliRunner().invoke(group, words)
    assert answer.exit_code == 2
    assert "both socketcan can0" in answer.output
