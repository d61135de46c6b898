"""`skinbus board flash` against simulated boards."""

from skinbus.config.system import load_arm
from skinbus.sim import World
from tests.cli.invoke import refused
from tests.firmware.images import make_image
from tests.master.commissioning.person import pressed_scene


def test_boards_get_a_program_unless_it_is_for_another_product(own_bus, tmp_path):
    def flash(product, *words, status):
        file = tmp_path / "image.bin"
        file.write_bytes(make_image(b"program", 0x534B4E42, product, 3))
        return own_bus.run("board", "flash", "pad", file, *words, status=status).splitlines()[-1]

    with own_bus.with_cores(World(pressed_scene(load_arm("pad")))):
        assert flash(0x5002, status=1).endswith("is 0x5001; the image is for 0x5002")
        assert "runs 0x" in flash(0x5001, "--node", 1, "--parallel", status=0)
        assert "runs 0x" in flash(0x5001, status=0)
        assert flash(0x5001, "--node", 1, "--node", 77, status=1).endswith("0x1018:01: no answer")


def test_file_that_is_no_image_is_refused(tmp_path):
    (tmp_path / "image.bin").write_bytes(b"\x7fELF")
    why = refused("board", "flash", "pad", tmp_path / "image.bin")
    assert "wanted what the build of a board makes" in why
