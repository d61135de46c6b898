"""The command line as a stranger meets it."""

import signal
import subprocess
import sys

import pytest
from click.testing import CliRunner

from skinbus import estimate
from skinbus.cli import COMMANDS, SUBCOMMANDS, group, main, options


def run(*args, **settings):
    return CliRunner().invoke(group, args, **settings)


def test_help_lists_every_command():
    result = run("--help")
    assert result.exit_code == 0
    for name in COMMANDS:
        assert name in result.output


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from click.testing import CliRunner; from skinbus.cli import group;"
        "CliRunner().invoke(group, ['--help']);"
        "heavy = ('numpy', 'numba', 'scipy', 'can', 'canopen', 'rich', 'pydantic');"
        "print([m for m in heavy if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_levels_of_the_command_line_are_those_of_the_estimator():
    assert options.LEVELS == estimate.LEVELS
    assert options.DEFAULT_LEVEL == estimate.DEFAULT_LEVEL


BELOW = [f"{name} {sub}" for name, subs in SUBCOMMANDS.items() for sub in subs]
OF_BOARD = [f"board {sub}" for sub in ("new", "lint", "firmware", "check")]


@pytest.mark.parametrize("name", [*COMMANDS, *BELOW, *OF_BOARD])
def test_every_command_has_help_with_an_example(name):
    result = run(*name.split(), "--help")
    assert result.exit_code == 0
    assert f"skinbus {name}" in result.output.partition("xample")[2]
    for sub in SUBCOMMANDS.get(name, ()):
        assert f"skinbus {name} {sub}" in result.output


def test_unknown_command_is_answered_with_a_suggestion():
    result = run("demmo")
    assert result.exit_code == 2
    assert "demo" in result.output


@pytest.fixture
def refused(monkeypatch, capfd):
    """Run the command line in this process; return its status and what it says of the error."""
    numbers = (signal.SIGTERM, signal.SIGHUP)
    usual = [signal.getsignal(number) for number in numbers]

    def refused(*args):
        monkeypatch.setattr(sys, "argv", ["skinbus", *args])
        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code, capfd.readouterr().err

    yield refused
    for number, handler in zip(numbers, usual, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("run", "forarm"), ("forarm", "forearm", "pad")),
        (("sim", "forarm"), ("forarm", "forearm")),
        (("run", "forearm", "--interface", "sockatcan"), ("sockatcan", "socketcan")),
        (("monitor", "pad", "--interface", "sockatcan"), ("sockatcan", "socketcan")),
        (("demo", "--level", "best"), ("best", "kmeans")),
        (("run", "pad", "--state", "/no/such/folder/x"), ("/no/such/folder",)),
        (("run", "forearm", "--seconds", "-1"), ("--seconds", "x>0")),
        (("replay", "none.log", "--arm", "pad"), ("file: wanted one that can be read (No such file",)),
        (
            ("calibrate", "presses", "x.log", "--arm", "pad", "--poses", "none.csv", "--out", "x.csv"),
            ("file: wanted one that can be read (No such file",),
        ),
        (("calibrate", "pad", "none.csv", "--out", "none.dcf"), ("one that can be read (No such file",)),
        (("board", "lint", "none.eds"), ("wanted an EDS or DCF file that can be read, or one of",)),
        (("plan", "none.toml"), ("wanted a file that can be read, or one of arm",)),
    ],
)
def test_wrong_word_gives_one_clear_message_and_status_2(refused, args, words):
    status, error = refused(*args)
    assert status == 2
    for word in words:
        assert word in error


def test_wrong_arm_file_shows_every_fault_at_once(refused, tmp_path):
    file = tmp_path / "bad.toml"
    file.write_text(
        '[arm]\nname = "bad"\nbitrate = "fast"\nrate_hz = -1\n'
        '[[link]]\nname = "l"\nsurface = "sphere"\nlength_mm = 100\n'
        '[[patch]]\nnode_id = 300\nlink = "m"\ns_mm = 10\nangel_deg = 3\n'
    )
    status, error = refused("run", str(file))
    assert status == 2
    for key in ("bitrate", "rate_hz", "surface", "node_id", "angel_deg"):
        assert key in error
