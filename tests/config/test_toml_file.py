"""TOML files: found by name or path, refused with the place of the fault."""

import os
from pathlib import Path

import pytest

from skinbus.config.toml_file import MAX_BYTES, find_toml, names_in, read_toml
from skinbus.errors import ConfigError
from tests.files import put


@pytest.fixture
def shipped(tmp_path):
    folder = tmp_path / "shipped"
    folder.mkdir()
    for name in ("two-words", "one"):
        put(folder, f"{name}.toml", "x = 1\n")
    return folder


def test_bare_word_is_a_name_and_spaces_are_as_good_as_hyphens(shipped):
    assert names_in(shipped) == ["one", "two-words"]
    for name in ("two-words", "two words"):
        assert find_toml(name, shipped, "arm") == shipped / "two-words.toml"


@pytest.mark.parametrize("name", ["three", "three.toml", "no/such/one", "p" * 5000, "p\0.toml"])
def test_what_is_not_there_is_answered_with_what_is(shipped, name):
    with pytest.raises(
        ConfigError, match=r"arm: is '.*'; wanted a file that can be read, or one of one, two-words"
    ):
        find_toml(name, shipped, "arm")


def test_a_slip_in_a_name_is_answered_with_the_nearest(shipped):
    with pytest.raises(ConfigError, match="did you mean 'two-words'"):
        find_toml("two-wrods", shipped, "arm")


def test_folder_is_no_file(shipped):
    with pytest.raises(ConfigError, match="wanted a file, not a folder"):
        find_toml(shipped, shipped, "scene")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b'[arm]\nname = "\xff"\n', "byte 14: wanted a TOML file: text in UTF-8"),
        (b"[arm]\nname = = 2\n", "line 2, column 8: wanted TOML: Invalid value"),
        (b"x = [", "end of document: wanted TOML: Invalid value"),
    ],
)
def test_fault_says_its_place(tmp_path, content, said):
    path = tmp_path / "x.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=said):
        read_toml(path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("x = " + "[" * 100_000, "tables and arrays that are less deep"),
        ("x = " + "{a = " * 100_000, "tables and arrays that are less deep"),
        ("a." * 50_000 + "a = 1", "keys of at most 16 parts"),
        ('"a".' * 50_000 + '"a" = 1', "keys of at most 16 parts"),
        ("x = " + "9" * 5000, "numbers and keys of at most 100 characters"),
        ("x = 1\n" * MAX_BYTES, f"at most {MAX_BYTES} bytes"),
    ],
    ids=["arrays", "tables", "dotted", "quoted", "digits", "size"],
)
def test_what_would_take_for_ever_is_refused_at_once(tmp_path, content, said):
    with pytest.raises(ConfigError, match=said) as caught:
        read_toml(put(tmp_path, "x.toml", content))
    assert len(str(caught.value)) < 1000


def test_brackets_and_dots_in_strings_and_comments_are_text(tmp_path):
    path = tmp_path / "x.toml"
    text = """
x = "[[[[[[[[[[[[[[[[[[[[[[[[[[[[ a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a \\" ["  # [[[[[[[[[[[[[[[[[[[[ {{{{{{
y = '[[[[[[[[[[[[[[[[[[[[[[[['
z = \"\"\"
[[[[[[[[[[[[[[[[[[[[[[[[[[[ \\\"\"\" a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p.q.r.s.t \"\"\"
"""
    path.write_text(text)
    assert set(read_toml(path)) == {"x", "y", "z"}


def test_a_pipe_or_device_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for path in (tmp_path / "pipe.toml", Path("/dev/zero")):
        with pytest.raises(ConfigError, match="a regular file"):
            read_toml(path)
