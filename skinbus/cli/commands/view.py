"""`skinbus view`: the arm in 3-D on a web page of this machine, with pressures and contacts."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinbus.cli.options import Where, bus_options, level_option, seconds_option
from skinbus.cli.output import echo
from skinbus.cli.stop_signals import Ending
from skinbus.errors import extra_wanted

if TYPE_CHECKING:
    from skinbus.model import Arm
    from skinbus.skin.contact import Level
    from skinbus.skin.skin import Skin

AGAIN_S = 1.0
"""After this time a scene that is over begins anew, and shared memory that has gone is looked for."""
YIELDS = 10
"""Niceness of the process: a master on this machine comes first."""


LOOPBACK = ("127.0.0.1", "::1", "localhost")
"""Addresses that are reached from this machine only."""


@click.command()
@click.argument("source")
@click.option("--arm", "recorded", metavar="ARM", help="The arm that SOURCE is a recording of.")
@bus_options
@click.option("--attach", "shared", metavar="NAME", help="Show what `skinbus run --share NAME` writes.")
@level_option("Level of the estimator, for a scene or a recording.")
@click.option(
    "--zero", is_flag=True, help="Take the first readings of each patch of a recording as its zero."
)
@click.option(
    "--host",
    default="127.0.0.1",
    help="Address to serve on; every machine that reaches it can see the skin.",
)
@click.option("--port", default=8080, type=click.IntRange(0, 65535), help="0: any.")
@seconds_option
def command(
    source: str,
    recorded: str | None,
    where: Where,
    shared: str | None,
    level: Level,
    zero: bool,
    host: str,
    port: int,
    seconds: float | None,
) -> None:
    """Show SOURCE on a web page of this machine: an arm on its buses, a scene, or a recording with --arm.

    An arm (a name or a TOML file) is shown with the contacts that its master publishes on the bus, and with
    the pressures of its readings. With --attach the page reads the shared memory of a master on this
    machine, which also holds covariances, quality and levels. A scene is simulated and shown with its true
    touches. If an arm and a scene have the same name, --channel or --attach chooses the arm. A recording of
    `skinbus record` or candump is played once, at its own speed.

    The page loads nothing from other machines. Its only command is a button that takes zeros. The button is
    on pages opened by the printed link, which has a token; other pages only show.

    \b
    Examples:
      skinbus view forearm
      skinbus view my-arm.toml --channel can0
      skinbus view forearm --attach arm
      skinbus view field.log --arm my-arm.toml
      skinbus view my-scene.toml --port 8081
    """
    with extra_wanted("view"):
        from skinbus.view.web.page import Page
    from skinbus.config.system import load_arm
    from skinbus.skin.replayed import replay
    from skinbus.view.web.follower import Follower

    with ExitStack() as stack:
        if recorded is not None:
            if where.interface is not None or where.bitrate is not None or shared is not None:
                raise click.UsageError("--arm shows a recording: no bus and no shared memory is used")
            title, arm = f"recording {source}", load_arm(recorded, check_load=False)
            played = partial(
                replay, source, arm, channel=where.channels, level=level, zero=zero, realtime=True
            )
            shown = Follower(played, gone="no cycles: the machine is too slow", has_zeros=False)
        else:
            if zero:
                raise click.UsageError("--zero is for a recording, with --arm")
            title, arm, opening, again_s = source_of(source, where, shared, level)
            shown = Follower(opening, again_s=again_s)
        stack.callback(shown.close)
        page = Page(arm, shown, title, host=host, port=port)
        stack.callback(page.close)
        if host not in LOOPBACK:
            echo(f"{host}: from all machines that reach it this page is seen", err=True)
        if port not in (0, page.server.get_port()):
            echo(f"port {port} is taken: another one is used", err=True)
        echo(f"{title}: {page.server.link}; Ctrl-C stops")
        os.nice(YIELDS)
        with Ending() as ending:
            page.run(seconds, lambda: ending.asked)


def source_of(
    source: str,
    where: Where,
    shared: str | None,
    level: Level,
) -> tuple[str, Arm, Callable[[], Skin], float | None]:
    """Return title, arm, source, and after what time a source that has ended is opened again, s."""
    from skinbus.config.system import load_arm
    from skinbus.skin.attached import attach
    from skinbus.skin.listened import listen
    from skinbus.skin.simulated import simulate

    if Path(source).is_file() and Path(source).suffix.lower() not in ("", ".toml"):
        raise click.UsageError(f"{source} is neither an arm nor a scene; a recording needs --arm ARM")
    on_bus = any(where)
    if shared is not None:
        if on_bus:
            raise click.UsageError("--attach reads shared memory: no bus is used")
        arm = load_arm(source, check_load=False)
        return f"{arm.name}, {shared}", arm, partial(attach, shared), AGAIN_S
    if not on_bus and is_scene(source):
        from skinbus.sim import load_scene

        scene = load_scene(source)
        opening = partial(simulate, scene, level=level, realtime=True, zero=scene.begins_untouched)
        return f"scene {source}", scene.arm, opening, AGAIN_S
    arm = load_arm(source, check_load=False)
    return arm.name, arm, partial(listen, arm, **where.words(), readings=True), None


def is_scene(source: str) -> bool:
    """Whether a word names a scene, a file that has a table of that name, or nothing."""
    from skinbus.sim.scene_file import scene_names

    with suppress(OSError, ValueError):  # load_arm says what is wrong with it
        path = Path(source)
        is_known = source in scene_names() or not path.exists()
        return is_known or "scene" in tomllib.loads(path.read_text(encoding="utf-8"))
    return False
