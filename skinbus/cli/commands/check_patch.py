"""`skinbus check-patch`: does the firmware of one board do what the profile asks for, rule by rule."""

from __future__ import annotations

import sys

import click
from rich.text import Text

from skinbus.cli.commands.scan import candidates_of
from skinbus.cli.console import Console
from skinbus.cli.host import Host
from skinbus.cli.options import bus_options, json_option
from skinbus.cli.output import JsonFile
from skinbus.errors import ConfigError, Fault
from skinbus.master.commissioning.patch_check import MS, RULES, CheckedPatch, Grade, PatchCheck, RuleResult
from skinbus.master.commissioning.scan import Scanner, match
from skinbus.objects.eds import load_eds
from skinbus.skin.addresses import find_place

POLL_S = 0.05
STYLES = {Grade.PASS: "green", Grade.FAIL: "bold red", Grade.SKIPPED: "dim"}


@click.command()
@bus_options
@click.option("--node", "node_id", required=True, type=click.IntRange(1, 126), help="Node-ID of the board.")
@click.option("--eds", help="EDS or DCF of the board; by default the one that ships and fits its identity.")
@click.option(
    "--response-ms",
    default=5.0,
    show_default=True,
    type=click.FloatRange(min=0.0, min_open=True),
    help="Longest time from SYNC to the last of its TPDOs.",
)
@click.option("--store", is_flag=True, help="Check storage too: the parameters stored in the board are lost.")
@json_option
def command(
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    node_id: int,
    eds: str | None,
    response_ms: float,
    store: bool,
    json_file: JsonFile | None,
) -> None:
    """Check the firmware of one board on a bus, rule by rule.

    The board is reset and started; nothing may press on it. No master may be at work on the bus. Status 1
    when a rule fails. The rules are in docs/profile.md.

    \b
    Examples:
      skinbus check-patch --channel can0 --node 5
      skinbus check-patch --channel can0 --node 5 --eds my-board.eds --store
    """
    place = find_place(interface, channel, bitrate)
    console = Console()
    scanner = Scanner([node_id])
    with Host(scanner, place.open, say=console.print) as host:
        host.wait(None, POLL_S)
    scanner.other_master.refuse(str(place))
    if node_id not in scanner.nodes:
        console.print(f"no node {node_id} on {place}")
        sys.exit(1)
    if eds is None:
        names = match(scanner.nodes[node_id], candidates_of(None)).names
        if not names:
            wanted = "the EDS of this board: none that ships with skinbus fits its identity"
            raise ConfigError("check-patch", [Fault("--eds", None, wanted)])
        eds = names[0]

    def show(result: RuleResult) -> None:
        grade, detail = result.finding.grade, result.finding.detail
        said = f"  {detail}" if detail else ""
        console.print(Text.assemble((f"{grade.value:7}", STYLES[grade]), f" {result.rule.name}{said}"))

    patch = CheckedPatch(node_id, load_eds(eds, node_id), round(response_ms * MS))
    check = PatchCheck(patch, RULES, destructive=store, on_result=show)
    console.print(f"node {node_id} on {place}, as {eds} describes it:")
    with Host(check, place.open, say=console.print) as host:
        host.wait(None, POLL_S)
    n_failed = sum(result.finding.grade is Grade.FAIL for result in check.results)
    console.print("all rules that were checked hold" if not n_failed else f"{n_failed} rules fail")
    if json_file:
        rows = [
            {"rule": r.rule.name, "grade": r.finding.grade.value.lower(), "detail": r.finding.detail}
            for r in check.results
        ]
        json_file.write({"node_id": node_id, "eds": eds, "rules": rows})
    sys.exit(0 if check.passed and len(check.results) == len(RULES) else 1)
