"""What goes in and out of a command: numbers, files and pipes that are wrong are one line, and in time."""

import os
import subprocess
import sys
from textwrap import dedent

import pytest
from click.testing import CliRunner

from skinbus.cli import group, output
from skinbus.config.arm_file import find_arm
from skinbus.objects.eds import find_eds
from tests.cli.processes import process


def run(*args):
    """Run a command in this process."""
    return CliRunner().invoke(group, args)


@pytest.mark.parametrize("number", ["nan", "inf"])
@pytest.mark.parametrize("option", ["--seconds", "--budget-us"])
def test_what_is_not_a_finite_number_is_refused(option, number):
    answer = run("run", "pad", option, number)
    assert answer.exit_code == 2
    assert "not a finite number" in answer.output


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("study", "paper", "--out", "/proc/figures"), "cannot make"),
        (("run", "pad", "--state", "/proc/x"), "/proc/x"),
    ],
)
def test_a_file_that_cannot_be_written_is_refused_before_the_work(args, said):
    answer = run(*args)
    assert answer.exit_code == 2, answer.output
    assert said in answer.output


def test_a_new_file_is_not_left_behind_by_the_question_whether_it_can_be_written(tmp_path):
    output.try_to_write(tmp_path / "new.json")
    assert not list(tmp_path.iterdir())
    (tmp_path / "old.json").write_text("old")
    output.try_to_write(tmp_path / "old.json")
    assert (tmp_path / "old.json").read_text() == "old"


@pytest.fixture
def own_arm(tmp_path):
    """An arm file of a user, with a board of its own, and the log of a robot."""
    for name in ("board.eds", "board.dcf"):
        (tmp_path / name).write_text(find_eds("skin-patch").read_text())
    (tmp_path / "robot.csv").write_text("t_s,s_mm,a_mm\n0,1,2\n")
    arm = tmp_path / "my.toml"
    arm.write_text(find_arm("pad").read_text().replace('"skin-patch"', '"board.dcf"'))
    return arm


@pytest.mark.parametrize(
    ("words", "target"),
    [
        (("replay", "{poses}", "--arm", "pad", "--out"), "my.toml"),
        (("run", "{arm}", "--state"), "board.eds"),
        (("study", "arm", "--out"), "my.toml"),
        (("calibrate", "{arm}", "{arm}", "--out"), "my.toml"),
        (("calibrate", "{arm}", "{arm}", "--out"), "board.dcf"),
        (("calibrate", "locate", "{arm}", "{poses}", "--out"), "board.dcf"),
        (("scan", "identify", "{arm}", "--out"), "board.dcf"),
        (("calibrate", "presses", "{arm}", "--arm", "pad", "--poses", "{poses}", "--out"), "robot.csv"),
        (("calibrate", "presses", "--out", "{poses}", "{arm}", "--arm", "pad", "--poses"), "robot.csv"),
    ],
)
def test_no_output_overwrites_an_input(own_arm, words, target):
    file = own_arm.parent / target
    before = file.read_bytes()
    poses = own_arm.parent / "robot.csv"
    answer = run(*(word.format(arm=own_arm, poses=poses) for word in words), str(file))
    assert answer.exit_code == 2, answer.output
    assert file.read_bytes() == before


def test_no_output_follows_a_symbolic_link(own_arm):
    link = own_arm.parent / "contacts.csv"
    link.symlink_to(own_arm)
    before = own_arm.read_bytes()
    answer = run("replay", str(own_arm), "--arm", "pad", "--out", str(link))
    assert answer.exit_code == 2
    assert "symbolic link" in answer.output
    assert own_arm.read_bytes() == before
    output.try_to_write("/dev/stdout")  # a link too, to what is open


@pytest.mark.parametrize("name", ["notes.txt", "x.health", "x.1"])
def test_a_file_of_anybody_else_is_not_lost_to_a_state(tmp_path, name):
    file, given = tmp_path / name, tmp_path / name.removesuffix(".health").removesuffix(".1")
    file.write_text("mine")
    answer = run("run", "pad", "--state", str(given))
    assert answer.exit_code == 2
    assert f"{file} is there already" in answer.output
    assert file.read_text() == "mine"


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
