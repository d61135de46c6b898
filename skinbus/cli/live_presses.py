"""Presses of a calibration made while a command waits: the dialogue on a bus, kept in a file."""

from __future__ import annotations

import csv
import io
import os
from collections import deque
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.host import Host, compiling
from skinbus.cli.press_csv import read_presses, reading_cells, reading_columns
from skinbus.cli.progress import progress
from skinbus.cli.typed_lines import TypedLines
from skinbus.estimate.presses.kinds import Press
from skinbus.master.commissioning.press_guide import PressGuide
from skinbus.master.commissioning.unplaced_boards import QuietMaster
from skinbus.model import Arm
from skinbus.skin.addresses import BusAddress
from skinbus.skin.compile_ahead import BASE

POLL_S = 0.05


def press_live(part: Arm, place: BusAddress, path: Path, force: float) -> bool:
    """Guide through presses of ``force`` (N, NaN: not known) on a bus; return whether they are complete.

    They are in the file at any time: after an interruption the same command goes on.
    """
    table = KeptPresses(part, path)
    console = Console()
    guide = PressGuide(part, force, table.load(force))
    cycles: deque[tuple[int, npt.NDArray[np.float64]]] = deque()
    typed = TypedLines()
    n_kept = n_shown = len(guide.presses)
    with compiling(console, BASE):
        master = QuietMaster(part, lambda *cycle: cycles.append(cycle))
    with progress(console, "presses", guide.n_planned, n_kept) as bar:

        def follow() -> None:
            nonlocal n_kept, n_shown
            answers = typed.take()
            while cycles and not guide.is_over:
                for text in guide.step(*cycles.popleft(), answers):
                    console.print(text, soft_wrap=True)
                answers = []
                if len(guide.presses) != n_kept:
                    n_kept = len(guide.presses)
                    table.save(guide.presses)
            if answers:
                typed.put_back(answers)
            bar(n_kept - n_shown, guide.n_planned)
            n_shown = n_kept

        with Host(
            master, place.open, final_frames=master.stop, say=partial(console.print, soft_wrap=True)
        ) as host:
            host.wait_until(lambda: guide.is_over, POLL_S, follow)
    return guide.is_over and not guide.is_quit


class KeptPresses:
    """The file of the presses, rewritten whole after each: a loss of power leaves the one before."""

    def __init__(self, part: Arm, path: Path) -> None:
        self._part = part
        self._path = path
        widest = max(placed.patch.n_tactels for placed in part.patches)
        self._widest = widest
        self._head = ["node_id", "s_mm", "a_mm", "force_n", *reading_columns(widest)]
        output.try_to_write(path)

    def load(self, force: float) -> list[Press]:
        """Return the presses of an earlier run; a file of another make, or another force, is refused."""
        if not self._path.exists():
            return []
        with self._path.open(encoding="utf-8", errors="replace") as file:
            if next(csv.reader([file.readline()]), []) != self._head:
                raise click.BadParameter(f"{self._path} was not made by --live; give a new name")
        presses = read_presses(self._part, self._path).presses
        if any(not np.array_equal(press.force, force, equal_nan=True) for press in presses):
            raise click.BadParameter(f"{self._path} has presses of another force; give a new name")
        return presses

    def save(self, presses: Sequence[Press]) -> None:
        """Write the presses."""
        text = io.StringIO(newline="")
        rows = csv.writer(text)
        rows.writerow(self._head)
        for press in presses:
            force = "" if np.isnan(press.force) else f"{press.force:g}"
            node_id = int(self._part.node_id[press.patch])
            at = [f"{1e3 * press.s:.3f}", f"{1e3 * press.a:.3f}"]
            gain = np.asarray(self._part.tactel_gain[self._part.tactels_of(press.patch)])
            cells = reading_cells(press.readings, press.noise, gain, self._widest)
            rows.writerow([node_id, *at, force, *cells])
        beside = self._path.with_name(f"{self._path.name}.new")
        beside.write_text(text.getvalue(), encoding="utf-8", newline="")
        os.replace(beside, self._path)
