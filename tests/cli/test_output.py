"""What goes in and out of a command: files and pipes that are wrong are one line, and in time."""

import os
import subprocess
import sys
from textwrap import dedent

import pytest

from skinbus.cli import output
from tests.files import put

HELP = "from skinbus import cli; sys.argv[1:] = ['--help']; cli.main()"
RICH = """
from skinbus import cli
from skinbus.cli.console import Console
cli.group.main = lambda **words: Console().print("a table")
cli.main()
"""


def python(code, stdout=subprocess.PIPE):
    """Run code in a process of its own, to its very end; return its status and standard error."""
    words = [sys.executable, "-c", "import os, sys\n" + dedent(code)]
    answer = subprocess.run(words, stdout=stdout, stderr=subprocess.PIPE, text=True)
    return answer.returncode, answer.stderr


def test_a_new_file_is_not_left_behind_by_the_question_whether_it_can_be_written(tmp_path):
    output.try_to_write(tmp_path / "new.json")
    assert not list(tmp_path.iterdir())
    put(tmp_path, "old.json", "old")
    output.try_to_write(tmp_path / "old.json")
    assert (tmp_path / "old.json").read_text() == "old"


@pytest.mark.parametrize("code", [HELP, RICH])
def test_an_output_that_is_full_is_one_line_and_status_2(code):
    with open("/dev/full", "w") as full:
        assert python(code, full) == (2, "skinbus: No space left on device\n")


@pytest.mark.parametrize("code", [HELP, RICH])
def test_a_reader_that_has_gone_ends_a_command_without_a_word(code):
    read, write = os.pipe()
    os.close(read)
    with open(write, "w") as gone:
        assert python(code, gone) == (output.BROKEN_PIPE, "")


def test_a_master_goes_on_without_a_reader():
    """Its console writes to nowhere; that of a command that only shows something ends it."""
    code = """
        from skinbus.cli.console import Console
        for outlives in (True, False):
            read, write = os.pipe()
            os.close(read)
            os.dup2(write, 1)
            Console(outlives_reader=outlives, width=80).print("to nobody")
            print("goes on", file=sys.stderr)
    """
    assert python(code) == (1, "goes on\n")


def test_a_fault_of_our_own_is_one_line_with_its_place():
    code = "from skinbus import cli; cli.group.main = lambda **words: 1 / 0; cli.main()"
    status, said = python(code)
    assert status == 70
    (line,) = said.splitlines()
    assert "ZeroDivisionError: division by zero (<string>:2)" in line
