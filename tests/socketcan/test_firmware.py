"""A board on a real interface: its C, made from an EDS and compiled for Linux, keeps every rule."""

import subprocess

from tests.cli.invoke import run
from tests.cli.patience import PATIENCE_S, until_in_time

NODE = "5"
OPTIONS = ("--store", "--syncs", "50", "--response-ms", "15")
"""A busy machine answers SYNC late; on the virtual bus 5 ms are asked for."""


def test_board_made_from_an_eds_passes_the_check(start, channel, tmp_path):
    run("board", "firmware", "skin-patch", "--out", tmp_path)
    subprocess.run(["make", "-s", "-C", tmp_path, "socketcan"], check=True)
    board = tmp_path / "board-socketcan"

    def check():
        with subprocess.Popen([board, channel, NODE, "1", tmp_path / "parameters.bin"]) as running:
            process = start("board", "check", "-c", channel, "--node", NODE, *OPTIONS)
            said, _ = process.communicate(timeout=PATIENCE_S)
            running.kill()
        return process.returncode, said

    status, said = until_in_time(check, lambda result: result[0] == 0)
    assert status == 0, said
    assert "all rules that were checked hold" in said
