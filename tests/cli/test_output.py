"""What goes in and out of a command: numbers, files and pipes that are wrong are one line, and in time."""

import os
import subprocess
import sys
from textwrap import dedent

import pytest

from skinbus.cli import output
from tests.cli.processes import process


def test_a_new_file_is_not_left_behind_by_the_question_whether_it_can_be_written(tmp_path):
    output.try_to_write(tmp_path / "new.json")
    assert not list(tmp_path.iterdir())
    (tmp_path / "old.json").write_text("old")
    output.try_to_write(tmp_path / "old.json")
    assert (tmp_path / "old.json").read_text() == "old"


@pytest.mark.slow
def test_an_output_that_is_full_is_one_line_and_status_2():
    with open("/dev/full", "w") as full:
        answer = process("scene", "list", stdout=full)
    assert answer.returncode == 2
    assert answer.stderr == "skinbus: No space left on device\n"


@pytest.mark.slow
@pytest.mark.parametrize("args", [("scene", "list"), ("run", "--help"), ("--help",)])
def test_a_reader_that_has_gone_ends_a_command_without_a_word(args):
    read, write = os.pipe()
    os.close(read)
    with open(write, "w") as gone:
        answer = process(*args, stdout=gone)
    assert (answer.returncode, answer.stderr) == (output.BROKEN_PIPE, "")


def test_a_master_goes_on_without_a_reader():
    """Its console writes to nowhere; that of a command that only shows something ends it."""
    code = """
        import os, sys
        from skinbus.cli.console import Console
        for outlives in (True, False):
            read, write = os.pipe()
            os.close(read)
            os.dup2(write, 1)
            Console(outlives_reader=outlives, width=80).print("to nobody")
            print("goes on", file=sys.stderr)
    """
    answer = subprocess.run([sys.executable, "-c", dedent(code)], capture_output=True, text=True)
    assert (answer.returncode, answer.stderr) == (1, "goes on\n")


def test_a_fault_of_our_own_is_one_line_with_its_place():
    code = "from skinbus import cli; cli.group.main = lambda **words: 1 / 0; cli.main()"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert answer.returncode == 70
    (line,) = answer.stderr.splitlines()
    assert "ZeroDivisionError: division by zero (<string>:1)" in line
