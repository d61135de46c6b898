"""The command line: one command per file, imported only when it is the one that runs."""

from __future__ import annotations

import faulthandler
import logging
import signal
import sys
import traceback
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import click

from skinbus import __version__
from skinbus.cli import output
from skinbus.errors import AddressError, BusError, ShareError, SkinbusError

GROUPS = {
    "Run": {
        "run": "Run the master of an arm: patches in, contacts out.",
        "sim": "Simulate the patches of a scene on a CAN bus.",
        "demo": "Run a simulated forearm and show its contacts beside the truth.",
        "guard": "Stop a robot when its skin is touched too hard; not certified.",
        "gateway": "Make patches of a skin whose frames are not CANopen.",
        "monitor": "Show the contacts that a master publishes on a bus.",
        "view": "Show an arm in 3-D on a web page of this machine.",
    },
    "Data": {
        "record": "Record all frames of a bus, as candump does.",
        "replay": "Compute the contacts of a recording again.",
        "export": "Write a recording for Foxglove or pandas, or the PDOs of an arm as a DBC.",
    },
    "Boards": {
        "scan": "List the nodes on a bus; give node-IDs; find which board sits where.",
        "configure": "Write the configuration of an arm into its patches, and store it there.",
        "patch": "Make a sensor that Python can read a patch on a CAN bus.",
        "board": "Make the EDS of your own board, check its file and its firmware.",
    },
    "Calibration": {"calibrate": "Learn contact law, gains and noise of boards from presses; locate boards."},
    "Design": {
        "plan": "Compute whether bus and machine can keep up, and what the skin of an arm covers.",
        "scene": "List what scenes can name, check a scene, measure its cost.",
        "study": "Measure what accuracy costs in time; remake the paper's figures.",
    },
    "Machine": {"doctor": "Check this machine, its bus and the health of a skin; compile the kernels."},
}
"""Groups of the first screen: name and one line of help of every command."""

COMMANDS = {name: text for commands in GROUPS.values() for name, text in commands.items()}

SUBCOMMANDS = {
    "scan": {
        "assign": "Give node-IDs to patches by LSS: by serial number, or in order.",
        "identify": "Find which board sits where on an arm, by pressing one after the other.",
    },
    "calibrate": {
        "presses": "Find the presses in a recording and join them with the log of a robot.",
        "locate": "Find where boards sit, and how they are turned, from presses at known places.",
    },
    "plan": {"coverage": "Compute what the skin of an arm feels where, and what it leaves blind."},
    "doctor": {
        "health": "Show what changed in each tactel since commissioning, and what to replace.",
        "warm": "Compile all kernels, so that the next start takes no time for it.",
    },
}
"""Commands below a command that also works without them; each has a module of its own name."""

EXAMPLES = """\b
Examples:
  skinbus demo                                     everything in one process, ten seconds
  skinbus sim forearm --interface socketcan --channel vcan0
  skinbus run forearm --interface socketcan --channel can0
  skinbus monitor forearm --interface socketcan --channel can0
"""


class LazyGroup(click.Group):
    """A group whose help needs no command's imports: `--help` answers at once."""

    def make_context(self, *args: Any, **extra: Any) -> click.Context:
        """Read the words; what is said of them is escaped."""
        with output.printable_errors():
            return super().make_context(*args, **extra)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the first screen."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of a command and return its ``command``; help names the commands below it."""
        name, _, sub = cmd_name.partition(" ")
        if name not in COMMANDS:
            return None
        command = import_module(f"skinbus.cli.commands.{sub or name}").command
        assert isinstance(command, click.Command)
        if subs := SUBCOMMANDS.get(cmd_name):
            lines = [f"  skinbus {cmd_name} {sub:<10} {text}" for sub, text in subs.items()]
            command.epilog = "\n".join(["\b", "More commands, each with --help:", *lines])
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; a name that is none is answered with the nearest."""
        name, *rest = args
        if name not in COMMANDS:
            near = [f"{above} {name}" for above, subs in SUBCOMMANDS.items() if name in subs]
            near += get_close_matches(name, COMMANDS, n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            ctx.fail(f"No such command {name!r}.{hint}")
        if rest and rest[0] in SUBCOMMANDS.get(name, ()):
            name, rest = f"{name} {rest[0]}", rest[1:]
        return name, self.get_command(ctx, name), rest

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; words that fit no bus of the arm are an error of usage; errors are escaped."""
        with output.printable_errors():
            try:
                return super().invoke(ctx)
            except AddressError as error:
                raise click.UsageError(str(error)) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands in their groups."""
        for title, commands in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(f"{name:9}", text) for name, text in commands.items()])


@click.group(
    cls=LazyGroup,
    epilog=EXAMPLES,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, prog_name="skinbus")
def group() -> None:
    """Contacts from tactile skin patches on a CAN bus: CANopen in, CANopen out, no ROS."""


def main() -> None:
    """Run the command line; its status is 0, or

    1  the answer is no: a finding, a patch that is not alive, a limit that is missed
    2  what was given is wrong: a word, a file that is faulty or cannot be written; again it would be too
    3  the bus cannot be used now: it is not there, or another master is at work; again it may be otherwise

    70 a fault of skinbus itself

    With 2, 3 and 70 goes one clear message. SIGTERM, and a terminal that goes away, end it as Ctrl-C does.
    """
    if not faulthandler.is_enabled() and sys.stderr:
        faulthandler.enable()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:  # not under nohup(1)
        signal.signal(signal.SIGHUP, signal.default_int_handler)
    if logging.lastResort:  # where records of libraries go that nobody configured
        logging.lastResort.setFormatter(output.PrintableLog())
    stdout = sys.stdout
    try:
        try:
            group.main(prog_name="skinbus")
        finally:
            sys.stdout.flush()
    except (SkinbusError, OSError, UnicodeDecodeError) as error:
        _refuse(error)
    except SystemExit as end:
        # click and rich end with 1 when the reader has gone: to a script, the answer "no". click has put
        # something in the place of the output then.
        if end.code == 1 and (output.is_broken_pipe(end.__context__) or sys.stdout is not stdout):
            sys.exit(output.BROKEN_PIPE)
        raise
    except Exception as error:
        if sys.flags.dev_mode:
            raise
        *_, last = traceback.extract_tb(error.__traceback__)
        where = f"{last.filename}:{last.lineno}"
        said = f"a fault of skinbus: {type(error).__name__}: {error} ({where})"
        output.echo(f"skinbus: {said}; `python -X dev -m skinbus` shows more, please report it", err=True)
        sys.exit(70)


def _refuse(error: SkinbusError | OSError | UnicodeDecodeError) -> None:
    """End with an error as one message."""
    if not isinstance(error, SkinbusError):
        output.forget_output()
        if output.is_broken_pipe(error):
            sys.exit(output.BROKEN_PIPE)
    said = error if isinstance(error, SkinbusError) else output.file_error(error)
    output.echo(f"skinbus: {said}", err=True)
    sys.exit(3 if isinstance(error, BusError | ShareError) else 2)
