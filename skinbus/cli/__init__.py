"""The command line: one command per file, imported only when it is the one that runs."""

from __future__ import annotations

import logging
import signal
import sys
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import click

from skinbus import __version__
from skinbus.cli import output
from skinbus.errors import AddressError, BusError, SkinbusError

COMMANDS = {
    "demo": "Run a simulated forearm and show its contacts beside the truth.",
    "sim": "Simulate the patches of a scene on a CAN bus.",
    "run": "Run the master of an arm: patches in, contacts out.",
    "configure": "Bring the patches of an arm to what its files say, and store it in them.",
    "presses": "Find the presses in a recording and join them with the log of a robot.",
    "calibrate": "Learn contact law, gains and noise of patches from presses at known places.",
    "scan": "List the nodes on a bus: identity, state, and the EDS that describes them.",
    "assign": "Give node-IDs to patches by LSS: by serial number, or in order.",
    "identify": "Find which board sits where on an arm, by pressing one after the other.",
    "locate": "Find where boards sit, and how they are turned, from presses at known places.",
    "board": "Make the EDS of a board of your own, and check it.",
    "check-patch": "Check the firmware of one board, rule by rule.",
    "monitor": "Show the contacts that a master publishes on a bus.",
    "view": "Show an arm in 3-D on a web page of this machine.",
    "record": "Record what is on a bus, as candump does.",
    "replay": "Make the contacts of a recorded bus again.",
    "export": "Write a recording for Foxglove, pandas or Wireshark, or the PDOs of an arm as a DBC.",
    "scene": "List what scenes can name, check a scene, measure what it costs.",
    "study": "Measure what accuracy costs in time; remake the paper's figures.",
    "plan": "Compute whether a bus and a machine can keep up with an arm.",
    "coverage": "Compute what the skin of an arm feels where, and what it leaves bare.",
    "profile": "Print what firmware must do, and all objects of boards and master.",
    "warm": "Compile all kernels, so that the next start takes no time for it.",
    "health": "Show what changed in each tactel since commissioning, and what to replace.",
    "doctor": "Check this machine and its bus, and say what to do for each finding.",
}
"""Name and one line of help of every command; the code is in the module of that name."""

EXAMPLES = """\b
Examples:
  skinbus demo                                     everything in one process, ten seconds
  skinbus sim forearm --interface socketcan --channel vcan0
  skinbus run forearm --interface socketcan --channel can0
  skinbus monitor --interface socketcan --channel can0
"""


class LazyGroup(click.Group):
    """A group whose help needs no command's imports: `--help` answers at once."""

    def make_context(self, *args: Any, **extra: Any) -> click.Context:
        """Read the words; what is said of them is escaped."""
        with output.printable_errors():
            return super().make_context(*args, **extra)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of a first visit."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of a command and return what it calls ``command``."""
        if cmd_name not in COMMANDS:
            return None
        command = import_module(f"skinbus.cli.commands.{cmd_name.replace('-', '_')}").command
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; a word that is none is answered with the nearest that is."""
        if args[0] not in COMMANDS:
            near = get_close_matches(args[0], COMMANDS, n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            ctx.fail(f"No such command {args[0]!r}.{hint}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; words that fit no bus of the arm are an error of usage; errors are escaped."""
        with output.printable_errors():
            try:
                return super().invoke(ctx)
            except AddressError as error:
                raise click.UsageError(str(error)) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table above."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LazyGroup, epilog=EXAMPLES, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="skinbus")
def group() -> None:
    """Contacts from tactile skin patches on a CAN bus: CANopen in, CANopen out, no ROS."""


def main() -> None:
    """Run the command line; its status is 0, or

    1  the answer is no: a finding, a patch that is not alive, a limit that is missed
    2  what was given is wrong: a word, a file that is faulty or cannot be written; again it would be too
    3  the bus cannot be used now: it is not there, or another master is at work; again it may be otherwise

    With 2 and 3 goes one clear message. SIGTERM, and a terminal that goes away, end a command as Ctrl-C does.
    """
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


def _refuse(error: SkinbusError | OSError | UnicodeDecodeError) -> None:
    """End with an error as one message."""
    if not isinstance(error, SkinbusError):
        output.forget_output()
        if output.is_broken_pipe(error):
            sys.exit(output.BROKEN_PIPE)
    said = error if isinstance(error, SkinbusError) else output.file_error(error)
    output.echo(f"skinbus: {said}", err=True)
    sys.exit(3 if isinstance(error, BusError) else 2)
