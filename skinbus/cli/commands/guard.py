"""`skinbus guard`: stop a robot when its skin is touched too hard."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import click

from skinbus.bus.realtime import take_priority
from skinbus.cli.console import Console
from skinbus.cli.host import QUICK_S, Host
from skinbus.cli.notify import Notifier
from skinbus.cli.options import Where, bus_options, function_named, seconds_option
from skinbus.cli.output import echo
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import ShareError
from skinbus.formatting import counted
from skinbus.guard.stops import NodeWrite, OutsideStop, parse_stop
from skinbus.guard.watch import ENDED, Guard, Phase, RegionPeaks, region_forces
from skinbus.model import Arm
from skinbus.model.guard import GuardSettings
from skinbus.skin.addresses import shown
from skinbus.skin.layout import digest
from skinbus.skin.shared_memory import SharedReader, name_for

LOOK_S = 0.01
"""How often contacts are read: half a cycle at 50 Hz."""

END_S = 2.0
"""How long an end waits for nodes that confirm, and for commands and functions that return."""


@click.command()
@click.argument("arm")
@click.option(
    "--stop",
    "stops",
    multiple=True,
    required=True,
    help="What stops the robot, see above; may be given several times.",
)
@bus_options
@click.option(
    "--contacts",
    "name",
    metavar="NAME",
    help="Shared memory of the master (`run --share NAME`): without fresh contacts there the robot stops. By "
    "default that of the name of the arm file, while it is there.",
)
@click.option("--acknowledge", is_flag=True, help="Take back the trips of patches from before.")
@seconds_option
def command(
    arm: str, stops: Sequence[str], where: Where, name: str | None, acknowledge: bool, seconds: float | None
) -> None:
    """Stop a robot when its skin is touched harder than [guard] of ARM allows. It is not certified.

    It waits until every guarded patch is armed, by `skinbus run`. Then these stop the robot: a patch that
    trips (GFC), is not armed, or is silent for 2.5 periods of its liveness; a master without heartbeat; a
    contact beyond the limits of its region; and the end of this command. It stays stopped until it is
    started again, and tells nodes again and again. Status 1: it stopped the robot by itself.

    \b
    Stops, all of them done at once; on an arm of several buses NODE is BUS/NODE:
      cia402:NODE                   quick stop of a drive: 0x6040 = 0x0002
      output:NODE:INDEX:SUB:VALUE   object of a node, hexadecimal: 00 is one byte, 0000 two
      command:PROGRAM ARGUMENT ...  started without a shell
      python:MODULE:FUNCTION        called without arguments

    \b
    Examples:
      skinbus guard my-arm.toml -c can0 --stop cia402:12 --stop "command:halt-robot --now"
      skinbus guard my-arm.toml -c can0 --stop output:12:6200:1:00 --contacts my-arm
      skinbus guard my-arm.toml -c can0 --stop python:my_robot:stop --acknowledge
    """
    echo("This guard is not certified: a risk assessment must not count on it.")
    loaded = load_arm(arm)
    if loaded.guard is None:
        raise click.UsageError(f"{arm} has no [guard]: there are no limits")
    asked, places = [parse_stop(text, loaded) for text in stops], where.places(*loaded.buses)
    told = [stop for stop in asked if isinstance(stop, NodeWrite)]
    guard = Guard(
        loaded, loaded.guard, ods_of(loaded), told, needs_contacts=name is not None, acknowledges=acknowledge
    )
    say = Console(outlives_reader=True).print
    outside = Outside([stop for stop in asked if isinstance(stop, OutsideStop)], say)
    contacts = SharedContacts(name or name_for(arm), loaded, loaded.guard)
    notifier = Notifier()

    def follow(step: object) -> None:
        """Follow a step of the core, in its thread."""
        if guard.phase is Phase.STOPPED:
            outside.begin.set()
        if guard.phase is not Phase.WAITING:
            notifier.alive(guard.reason or "guarding")

    host = Host(
        guard,
        places,
        on_step=follow,
        say=say,
        urgent=True,
    )
    echo(
        f"{loaded.name}: {loaded.guarded.sum()} of {counted(loaded.n_patches, 'patch')} guarded on "
        f"{shown(places)}; stops: {', '.join(stops)}; Ctrl-C stops the robot, too"
    )
    if name and contacts.read() is None:
        echo(f"no contacts of this arm yet: does `skinbus run --share {name}` run?")
    try:
        with host:
            host.wait(seconds, LOOK_S, lambda: setattr(guard, "contacts", contacts.read()))
            notifier.stopping()
            guard.is_ending, end_s = True, time.monotonic() + END_S
            while not guard.is_settled and time.monotonic() < end_s:
                follow(None)  # its thread may have failed
                time.sleep(QUICK_S)
    finally:
        follow(None)
        if guard.phase is Phase.STOPPED:
            outside.join()
            say(f"stopped: {guard.reason}")
    notifier.close()
    sys.exit(guard.reason not in ("", ENDED))


class SharedContacts:
    """The contacts that a master of this arm shares, by region."""

    def __init__(self, name: str, arm: Arm, settings: GuardSettings) -> None:
        self._name, self._arm, self._settings, self._geometry = name, arm, settings, digest(arm)
        self._reader: SharedReader | None = None

    def read(self) -> RegionPeaks | None:
        """Return the newest; None while nobody shares any."""
        try:
            reader = self._reader = self._reader or SharedReader(self._name)
            if reader.is_alive and not reader.is_stopped and reader.layout.geometry == self._geometry:
                if (slot := reader.read_from(reader.newest)) is None:
                    return None
                found = slot["contacts"][: slot["n_contacts"]]
                columns = (found[name] for name in ("link", "s", "a", "force"))
                forces = region_forces(self._arm, self._settings, *columns)
                felt, regions = slot["pressures"], self._settings.regions
                pressures = [felt[region.tactels].max(initial=0.0) for region in regions]
                return RegionPeaks(int(slot["t_ns"]), forces, pressures)
        except ShareError:
            pass
        if self._reader:
            self._reader.close()
            self._reader = None
        return None


class Outside:
    """Commands and functions that stop a robot, each in a thread of its own that only waits for that."""

    def __init__(self, stops: Sequence[OutsideStop], say: Callable[[str], Any]) -> None:
        """Prepare them: functions first, they are faster."""
        self.begin = threading.Event()
        self._say = say
        ordered = sorted(stops, key=lambda stop: stop.kind != "python")
        self._threads = [
            threading.Thread(target=self._wait, args=(f"{stop.kind}:{stop.what}", _call(stop)), daemon=True)
            for stop in ordered
        ]
        for thread in self._threads:
            thread.start()

    def join(self) -> None:
        """Wait until they have done so, as long as an end may take."""
        for thread in self._threads:
            thread.join(END_S)

    def _wait(self, label: str, call: Callable[[], Any]) -> None:
        [*take_priority()]  # the core says what is not allowed
        self.begin.wait()
        try:
            call()
            self._say(f"done: {label}")
        except BaseException as error:  # noqa: BLE001 - whatever a function raises is said
            self._say(f"STOP FAILED: {label}: {error!r}")


def _call(stop: OutsideStop) -> Callable[[], Any]:
    """Return what does a stop; what is not there is refused."""
    if stop.kind == "python":
        return function_named(stop.what)
    try:
        words = shlex.split(stop.what)
    except ValueError as error:
        raise click.UsageError(f"--stop command: {error}") from error
    if shutil.which(words[0]) is None:
        raise click.UsageError(f"--stop command: there is no program {words[0]!r}")
    return partial(subprocess.run, words, stdin=subprocess.DEVNULL, start_new_session=True, check=True)
