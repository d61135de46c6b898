"""What `skinbus view` shows of a word: a scene, or an arm on its bus; wrong words are refused in a line."""

import os
import socket

from skinbus.cli.commands.view import is_scene
from tests.cli.invoke import run
from tests.files import put


def test_word_that_names_arm_and_scene_is_a_scene_and_a_file_is_what_its_tables_say(tmp_path):
    assert is_scene("forearm")
    assert not is_scene(str(put(tmp_path, "arm.toml", '[arm]\nname = "x"\n')))
    assert is_scene(str(put(tmp_path, "scene.toml", '[scene]\narm = "pad"\n')))
    assert not is_scene(str(tmp_path))


def test_a_port_that_is_taken_is_named(monkeypatch):
    monkeypatch.setattr(os, "nice", lambda by: 0)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        answer = run("view", "pad", "--level", "kmeans", "--seconds", 0.1, "--port", port)
    assert f"port {port} is taken" in answer
