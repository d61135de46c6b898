"""Hostile strings go through everything that commands print with; nothing of them is obeyed."""

import io
import re
from types import SimpleNamespace

import click
import pytest
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from skinbus.can.event import Event, EventKind
from skinbus.cli import output
from skinbus.cli.commands import assign, configure, scan
from skinbus.cli.console import Console
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError, Fault
from skinbus.master.commissioning.node_id_assignment import Address, Assigned, Assignment
from skinbus.master.commissioning.scan import Found, Match
from skinbus.master.patches.provisioning import Provision, Provisioned
from skinbus.model import Arm, Link
from skinbus.objects.contacts import ContactState
from skinbus.view.event_log import EventLog
from skinbus.view.screen import Screen
from skinbus.view.table import contact_table
from tests.cli.invoke import run

HOSTILE = [
    "\x1b]0;title\x07",
    "\x1b[2J\x1b[H",
    "\x1b]8;;http://evil\x1b\\link\x1b]8;;\x1b\\",
    "\x9b31mC1\x9c",
    "back\b\b\bspace\r over",
    "\u202ereversed\u2066",
    "\u2028separated",
    "[/red]",
    "[red]colour[/]",
    "[link=http://evil]x[/link]",
    ":skull:",
    "\x00nul\x7f",
]
BY_RICH = re.compile(r"\x1b\[[0-9;]*m|\x1b\[\?25[hl]|\x1b\[[0-9]*[AK]|\r")
"""Colours, the cursor and the lines of a live screen."""


def on_console(show):
    """What a terminal gets of ``show(console)``."""
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    show(console)
    return BY_RICH.sub("", console.file.getvalue())


def table_of(text):
    table = Table("head", text, title=text, caption=text)
    table.add_row(text, Text(text))
    return table


def event_lines(text):
    lines = []
    log = EventLog(lines.append, ["upper", text], now=lambda: 0.0)
    log.take(Event(t_ns=0, kind=EventKind.BUS_LOST, detail=text, bus=1))
    log.show(all_of_it=True)
    return "\n".join(lines)


PAD = load_arm("pad")


def named_arm(text):
    return Arm(text, [Link(text, link.surface) for link in PAD.links], PAD.patches, *PAD.buses)


def row(text):
    held = SimpleNamespace(id=1, link=text, state=ContactState.HELD, s=0.0, a=0.0, force=1.0)
    return contact_table([held])


def found(text):
    node = Found(5, answers=True, name=text)
    return scan.row_of(node, Match((text,), True))


def live(text):
    def show(console):
        with Live(console=console, auto_refresh=False) as screen:
            screen.update(Group(text, table_of(text)), refresh=True)
            console.print(text)

    return show


SINKS = {
    "a line": lambda text: on_console(lambda c: c.print(text, style="yellow")),
    "a line with styles": lambda text: on_console(lambda c: c.print(Text.assemble(("!", "red"), text))),
    "a table": lambda text: on_console(lambda c: c.print(table_of(text))),
    "a live screen": lambda text: on_console(live(text)),
    "scan": lambda text: on_console(lambda c: c.table(scan.TITLES, [found(text)], text)),
    "monitor": lambda text: on_console(lambda c: c.print(row(text))),
    "run": lambda text: on_console(lambda c: c.print(Screen(named_arm(text)).render(None))),
    "assign": lambda text: on_console(
        lambda c: c.print(assign.line(Assignment(Address(1, 2, 3, 4), 5, Assigned.NOT_STORED, text)))
    ),
    "configure": lambda text: on_console(
        lambda c: configure.show(c, named_arm(text), {1: None}, {1: Provisioned(Provision.REFUSED, text)})
    ),
    "event log": event_lines,
    "fault of a file": lambda text: str(ConfigError(text, [Fault(text, text, text)])),
}


@pytest.mark.parametrize("text", HOSTILE, ids=ascii)
@pytest.mark.parametrize("sink", SINKS)
def test_nothing_of_a_hostile_string_is_obeyed(sink, text):
    said = SINKS[sink](text)
    assert said.replace("\n", "").isprintable()
    if text.isprintable() and sink != "run":
        assert text in said  # shown as it is, without effect


@pytest.mark.parametrize("text", HOSTILE, ids=ascii)
def test_echo_and_errors_escape(text, capsys):
    output.echo(text)
    output.echo(text, err=True)
    with pytest.raises(click.UsageError) as caught, output.printable_errors():
        raise click.BadParameter(f"{text} is wrong")
    caught.value.show()
    said = "".join(capsys.readouterr())
    assert said.replace("\n", "").isprintable()


def test_a_string_cannot_forge_a_line_of_the_log():
    assert "\n" not in event_lines("lost\n2026-11-22 00:00:00.0 bus-back: all is well")


@pytest.mark.parametrize(
    "words", [["\x1b[2J"], ["run", "pad", "--interface", "\x1b[2J"], ["scan", "--\x1b[2J"]]
)
def test_words_of_the_command_line_are_escaped(words):
    said = run(*words, status=2)
    assert "\x1b" not in said
    assert r"\x1b[2J" in said
