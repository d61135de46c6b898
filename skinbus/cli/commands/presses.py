"""`skinbus calibrate presses`: presses from a recording and the log of a robot."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import click
import numpy as np

import skinbus
from skinbus.arrays import Floats
from skinbus.cli import output
from skinbus.cli.options import INPUT, POSITIVE, channels_option, file_option
from skinbus.cli.output import echo
from skinbus.cli.press_csv import read_columns, write_presses
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import ConfigError
from skinbus.estimate.calibration.recording import find_holds, find_offset, load_of, pose_signal
from skinbus.estimate.calibration.table import Press, mean_and_noise
from skinbus.formatting import counted
from skinbus.model import Arm
from skinbus.objects.readings import ReadingsPlan

SLID = 0.5e-3
"""m, that a tool may move within a hold; more is no press at a place."""
FELT = 0.02
"""Part of the largest reading of a press from which a neighbouring patch gets a row of it, too."""
DOUBTFUL = 0.4
"""Correlation below which clocks are not taken as joined: half of what a few good presses give."""
FEWEST = 10
"""Cycles of a recording."""
HELD_S = 0.02
"""Where patches send on a change, what is read holds between cycles: it is looked at so often, s."""


@click.command()
@click.argument("log", type=INPUT)
@click.option("--arm", required=True, help="The arm whose patches were recorded: a name or a TOML file.")
@click.option(
    "--poses",
    required=True,
    type=INPUT,
    help="Places of the tip over time: t_s with s_mm, a_mm (and height_mm), or x_mm, y_mm, z_mm in the "
    "frame of the link; force_n if the robot measures it.",
)
@click.option("--weight-n", type=POSITIVE, help="Force of all presses, N.")
@click.option("--link", "link_name", help="The link that is pressed; by default the only one.")
@channels_option
@file_option(
    "--out", required=True, callback=output.writable, help="The CSV file that `skinbus calibrate` reads."
)
def command(
    log: Path,
    arm: str,
    poses: Path,
    weight_n: float | None,
    link_name: str | None,
    channels: tuple[str, ...],
    out: Path,
) -> None:
    """Find the presses in LOG, a recording of `skinbus record` or candump: where they were and how strong.

    A press counts while its readings stand still for 0.15 s. The clocks need not agree: the command finds
    their offset by correlating the load of the skin with the force, or with a tool that stands still (and
    near, if its height is known), and prints it. Press for half a second or more, at uneven times, and move
    between presses.

    Status 0: presses were written. 1: none were found, or the clocks cannot be joined. 2: bad file or
    argument.

    \b
    Examples:
      skinbus calibrate presses field.log --arm pad --poses robot.csv --out presses.csv
      skinbus calibrate presses field.log --arm pad --poses robot.csv --weight-n 4.905 --out presses.csv
    """
    output.keep_files([out], "--poses", [poses.resolve()])
    whole = load_arm(arm, check_load=False)
    names = [link.name for link in whole.links]
    if link_name not in (names if len(names) > 1 else [None, *names]):
        raise click.BadParameter(f"give one of {', '.join(names)}", param_hint="--link")
    link = names.index(link_name or names[0])
    pose = _poses(whole, link, poses)
    t, pressures = _cycles(log, whole, channels)
    load, signal = load_of(pressures, whole.tactel_threshold), pose.get("force_n")
    if signal is None:
        signal = pose_signal(pose["t_s"], pose["s"], pose["a"], pose.get("height"))
    try:
        offset = find_offset(t, load, pose["t_s"], signal)
        if offset.correlation < DOUBTFUL:
            raise ValueError(f"poses go with the load of the skin by {offset.correlation:.2f} at best")
    except ValueError as error:
        _end(f"the clocks cannot be joined: {error}")
    echo(f"clock of the poses: {offset.s:+.3f} s to that of the skin (correlation {offset.correlation:.2f})")
    force = pose.get("force_n", np.nan) if weight_n is None else weight_n
    columns = np.stack(np.broadcast_arrays(pose["s"], pose["a"], force), -1)
    presses: list[Press] = []
    holds, n_left = find_holds(t, load), 0
    for begin, end in holds:
        # the middle half of a hold, whatever the clocks are off by
        own = columns[np.abs(pose["t_s"] + offset.s - 0.5 * (begin + end)) <= 0.25 * (end - begin)]
        if not len(own) or own[:, 2].mean() <= 0.0 or np.ptp(own[:, :2], axis=0).max() > SLID:
            n_left += 1
            continue
        readings = mean_and_noise(pressures[(t >= begin) & (t <= end)])
        presses += felt(whole, link, own.mean(axis=0).tolist(), *readings)
    if not presses:
        _end(f"no press: {counted(len(holds), 'hold')}, in none of them a tool that stands still")
    write_presses(out, whole, presses)
    left = f", {n_left} left out: the tool moved, or there was no force" if n_left else ""
    n_felt = len({press.patch for press in presses})
    echo(f"{counted(len(holds) - n_left, 'press')} on {counted(n_felt, 'patch')}{left}")
    echo(f"{out}: {counted(len(presses), 'line')}")


def _end(why: str) -> NoReturn:
    echo(why, err=True)
    sys.exit(1)


def _poses(arm: Arm, link: int, path: Path) -> dict[str, Floats]:
    """Return the columns of a log of poses: t_s, s, a (m); height (m) and force_n if there."""
    columns = read_columns(
        path, [("t_s", "s_mm", "a_mm"), ("t_s", "x_mm", "y_mm", "z_mm")], ["height_mm", "force_n"]
    )
    if not np.isfinite(columns.get("force_n", 0.0)).all():
        raise ConfigError.of(path, "force_n", "no number in some lines", "numbers")
    metres = {name.removesuffix("_mm"): 1e-3 * column for name, column in columns.items() if "_mm" in name}
    if "s" not in metres:
        points = np.stack([metres[name] for name in "xyz"], -1)
        metres |= zip(("s", "a", "height"), arm.links[link].surface.project(points), strict=True)
    return columns | metres


def _cycles(log: Path, arm: Arm, channels: tuple[str, ...]) -> tuple[Floats, Floats]:
    """Return the times (n,) s of the cycles of a recording, and pressures (n, n_tactels) Pa."""
    with skinbus.replay(log, arm, channel=channels, level="kmeans", zero=True) as skin:
        cycles = [(1e-9 * c.t_ns, np.where(c.readings.valid, c.readings.pressures, np.nan)) for c in skin]
    if len(cycles) < FEWEST:
        raise ConfigError.of(log, "file", counted(len(cycles), "cycle"), "a recording of presses")
    t, pressures = map(np.array, zip(*cycles, strict=True))
    if not ReadingsPlan(arm, ods_of(arm)).on_change.any():
        return t, pressures
    every = np.arange(t[0], t[-1], HELD_S)
    return every, pressures[np.searchsorted(t, every, "right") - 1]


def felt(arm: Arm, link: int, push: Sequence[float], readings: Floats, noise: Floats) -> Iterator[Press]:
    """Return what each patch of a link has of a push at s, a (m) by a force (N), read by all tactels."""
    (s, a, force), most = push, np.nanmax(readings, initial=0.0)
    for p in np.flatnonzero(arm.patch_link == link).tolist():
        here = arm.tactels_of(p)
        if np.nanmax(readings[here], initial=0.0) > FELT * most:
            yield Press(p, s, a, force, readings[here], noise=noise[here])
