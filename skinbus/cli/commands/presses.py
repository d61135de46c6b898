"""`skinbus calibrate presses`: presses from a recording and the log of a robot."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt

import skinbus
from skinbus.cli import output
from skinbus.cli.formatting import counted
from skinbus.cli.options import Range, file_option, log_channels_option
from skinbus.cli.output import echo
from skinbus.cli.press_csv import read_columns, reading_cells, reading_columns
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError, Fault
from skinbus.estimate.presses.holds import ClockOffset, Hold, find_holds, find_offset, load_of, pose_signal
from skinbus.estimate.presses.single_noise import mean_and_noise
from skinbus.model import Arm
from skinbus.skin.addresses import channels_by_name

Floats = npt.NDArray[np.float64]

SLID = 0.5e-3
"""m, that a tool may move within a hold; more is no press at a place."""
FELT = 0.02
"""Part of the largest reading of a press from which a neighbouring patch gets a row of it, too."""
DOUBTFUL = 0.4
"""Correlation below which clocks are not taken as joined: half of what a few good presses give."""


@click.command()
@click.argument("log", type=output.Readable(path_type=Path))
@click.option("--arm", required=True, help="The arm whose patches were recorded: a name or a TOML file.")
@click.option(
    "--poses",
    required=True,
    type=output.Readable(path_type=Path),
    help="Places of the tip over time: t_s with s_mm, a_mm (and height_mm), or x_mm, y_mm, z_mm in the "
    "frame of the link; force_n if the robot measures it.",
)
@click.option(
    "--forces",
    "force_file",
    type=output.Readable(path_type=Path),
    help="Forces over time: t_s, force_n, on a clock of its own.",
)
@click.option("--weight-n", type=Range(min=0.0, min_open=True), help="The same force in all presses, N.")
@click.option("--link", "link_name", help="The link that is pressed; by default the only one.")
@log_channels_option
@file_option(
    "--out", required=True, callback=output.writable, help="The CSV file that `skinbus calibrate` reads."
)
def command(
    log: Path,
    arm: str,
    poses: Path,
    force_file: Path | None,
    weight_n: float | None,
    link_name: str | None,
    channels: tuple[str, ...],
    out: Path,
) -> None:
    """Find the presses in LOG, a recording of `skinbus record` or candump: where they were and how strong.

    A press counts while its readings stand still for 0.15 s. The clocks need not agree: their offset is that
    at which the load of the skin goes with the force, or with a tool that stands still (and near, if its
    height is known); it is printed with its standard deviation. Press for half a second or more, at uneven
    times, and move between presses.

    Status 0: presses were written. 1: none were found, or the clocks cannot be joined. 2: bad file or
    argument.

    \b
    Examples:
      skinbus calibrate presses field.log --arm pad --poses robot.csv --forces scale.csv --out presses.csv
      skinbus calibrate presses field.log --arm pad --poses robot.csv --weight-n 4.905 --out presses.csv
    """
    whole = load_arm(arm, check_load=False)
    link = _link(whole, link_name)
    t_pose, s, a, height, own_force = _poses(whole, link, poses)
    if force_file is not None and weight_n is not None:
        raise click.UsageError("--forces and --weight-n exclude each other")
    where = channels_by_name(whole.buses, channels)
    said = {bus.name: channel for bus, channel in zip(whole.buses, where, strict=True) if channel}
    with skinbus.replay(log, whole, channel=said, level="kmeans", zero=True) as skin:
        cycles = [(1e-9 * c.t_ns, c.readings.pressures.copy(), c.readings.valid.copy()) for c in skin]
    if len(cycles) < 10:
        raise ConfigError(str(log), [Fault("file", counted(len(cycles), "cycle"), "a recording of presses")])
    t = np.array([cycle[0] for cycle in cycles])
    pressures = np.array([np.where(cycle[2], cycle[1], np.nan) for cycle in cycles])
    load = load_of(pressures, np.asarray(whole.tactel_threshold))
    t_force, force = t_pose, own_force
    if force_file is not None:
        columns = read_columns(force_file, [("t_s", "force_n")])
        t_force, force = columns["t_s"], columns["force_n"]
    try:
        same_clock = force_file is None and own_force is not None
        signal = own_force if own_force is not None else pose_signal(t_pose, s, a, height)
        to_pose = _joined(find_offset(t, load, t_pose, signal), "poses")
        to_force = to_pose
        if force is not None and not same_clock:
            to_force = _joined(find_offset(t, load, t_force, force), "forces")
    except ValueError as error:
        echo(f"the clocks cannot be joined: {error}", err=True)
        sys.exit(1)
    rows: list[list[object]] = []
    n_left = 0
    holds = find_holds(t, load)
    for hold in holds:
        place = _steady(hold, to_pose, t_pose, s, a)
        newton = weight_n
        if force is not None and weight_n is None:
            newton = _mean(hold, to_force, t_force, force)
        if place is None or (newton is not None and not newton > 0.0):
            n_left += 1
            continue
        within = (t >= hold.begin) & (t <= hold.end)
        rows += rows_of(whole, link, hold, place, newton, *mean_and_noise(pressures[within]))
    if not rows:
        echo(f"no press: {counted(len(holds), 'hold')}, in none of them a tool that stands still", err=True)
        sys.exit(1)
    widest = max(placed.patch.n_tactels for placed in whole.patches)
    with out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        board = ["node_id", "bus"] if len(whole.buses) > 1 else ["node_id"]
        writer.writerow(["t_s", *board, "s_mm", "a_mm", "force_n", *reading_columns(widest)])
        writer.writerows(rows)
    left = f", {n_left} left out: the tool moved, or there was no force" if n_left else ""
    n_felt = len({tuple(row[1 : 1 + len(board)]) for row in rows})
    echo(f"{counted(len(holds) - n_left, 'press')} on {counted(n_felt, 'patch')}{left}")
    echo(f"{out}: {counted(len(rows), 'line')}")


def _link(arm: Arm, name: str | None) -> int:
    names = [link.name for link in arm.links]
    if name is None and len(names) == 1:
        return 0
    if name not in names:
        raise click.BadParameter(f"give one of {', '.join(names)}", param_hint="--link")
    return names.index(name)


def _poses(arm: Arm, link: int, path: Path) -> tuple[Floats, Floats, Floats, Floats | None, Floats | None]:
    """Return times (s), places on the link (m), height over it (m) and force (N) if there."""
    columns = read_columns(
        path, [("t_s", "s_mm", "a_mm"), ("t_s", "x_mm", "y_mm", "z_mm")], ["height_mm", "force_n"]
    )
    force = columns.get("force_n")
    if force is not None and not np.isfinite(force).all():
        raise ConfigError(str(path), [Fault("force_n", "no number in some lines", "numbers")])
    height = columns.get("height_mm")
    if "s_mm" in columns:
        s, a = 1e-3 * columns["s_mm"], 1e-3 * columns["a_mm"]
        return columns["t_s"], s, a, None if height is None else 1e-3 * height, force
    points = 1e-3 * np.stack([columns["x_mm"], columns["y_mm"], columns["z_mm"]], -1)
    return columns["t_s"], *arm.links[link].surface.project(points), force


def _joined(offset: ClockOffset, what: str) -> ClockOffset:
    """Print an offset, or raise ValueError where nothing agrees."""
    if offset.correlation < DOUBTFUL:
        raise ValueError(f"{what} go with the load of the skin by {offset.correlation:.2f} at best")
    echo(
        f"clock of the {what}: {offset.s:+.3f} s to that of the skin (sd {1e3 * offset.sd:.0f} ms, "
        f"correlation {offset.correlation:.2f})"
    )
    if offset.uneven:
        begin, end, correlation = offset.uneven
        echo(
            f"note: from {begin:.0f} to {end:.0f} s of the recording the correlation is {correlation:.2f}: "
            f"was the clock of the {what} set, or does its log have gaps? Presses may have {what} of others",
            err=True,
        )
    return offset


def _within(hold: Hold, offset: ClockOffset, t: Floats) -> npt.NDArray[np.bool_]:
    """Return the samples of another clock that are in a hold for sure."""
    margin = min(3.0 * offset.sd, 0.25 * (hold.end - hold.begin))
    return np.asarray((t + offset.s >= hold.begin + margin) & (t + offset.s <= hold.end - margin))


def _steady(hold: Hold, offset: ClockOffset, t: Floats, s: Floats, a: Floats) -> tuple[float, float] | None:
    """Return the place of a hold, m; None where the tool moved or there is no pose."""
    rows = _within(hold, offset, t)
    if not rows.any() or max(np.ptp(s[rows]), np.ptp(a[rows])) > SLID:
        return None
    return float(np.mean(s[rows])), float(np.mean(a[rows]))


def _mean(hold: Hold, offset: ClockOffset, t: Floats, values: Floats) -> float:
    rows = _within(hold, offset, t)
    return float(np.mean(values[rows])) if rows.any() else 0.0


def rows_of(
    arm: Arm,
    link: int,
    hold: Hold,
    place: tuple[float, float],
    newton: float | None,
    means: Floats,
    noise: Floats,
) -> list[list[object]]:
    """Return a line for each patch of the link that feels a press; with its bus where there are several."""
    most = float(np.nanmax(means, initial=0.0))
    widest = max(placed.patch.n_tactels for placed in arm.patches)
    lines: list[list[object]] = []
    for p, placed in enumerate(arm.patches):
        here = arm.tactels_of(p)
        own = means[here]
        if placed.link != link or not np.nanmax(own, initial=0.0) > FELT * most:
            continue
        force = "" if newton is None else f"{newton:.4f}"
        read = reading_cells(own, noise[here], np.asarray(arm.tactel_gain[here]), widest)
        at = [f"{1e3 * place[0]:.3f}", f"{1e3 * place[1]:.3f}"]
        board = [placed.node_id, arm.buses[placed.bus].name] if len(arm.buses) > 1 else [placed.node_id]
        lines.append([f"{hold.begin:.3f}", *board, *at, force, *read])
    return lines
