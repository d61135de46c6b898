"""Dialogues about presses on a bus, and those of a calibration, which are kept in a file."""

from __future__ import annotations

import csv
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.host import QUICK_S, Host, compiling
from skinbus.cli.press_csv import columns_of, read_presses, write_presses
from skinbus.estimate.calibration.table import Press
from skinbus.master.commissioning.press_dialogue import PressDialogue
from skinbus.master.commissioning.press_guide import PressGuide
from skinbus.master.commissioning.unplaced_boards import QuietMaster
from skinbus.model import Arm
from skinbus.skin.addresses import BusAddress


def talk(
    dialogue: PressDialogue, arm: Arm, place: BusAddress, console: Console, follow: Callable[[], Any]
) -> None:
    """Run a dialogue on a bus until it is over; Ctrl-C leaves the rest for later.

    Args:
        dialogue: gets the pressures of the boards, and what is typed meanwhile.
        arm: the boards.
        place: of the bus.
        console: where the dialogue is shown.
        follow: is called after the dialogue went on.
    """
    cycles: deque[tuple[int, npt.NDArray[np.float64]]] = deque()
    typed: deque[str] = deque()
    reader = threading.Thread(target=_read, args=(sys.stdin, typed), name="typed lines", daemon=True)
    reader.start()
    say = partial(console.print, soft_wrap=True)
    with compiling(console):
        master = QuietMaster(arm, lambda *cycle: cycles.append(cycle))

    def go_on() -> None:
        while cycles and not dialogue.is_over:
            answers = [typed.popleft() for _ in range(len(typed))]
            for text in dialogue.step(*cycles.popleft(), answers):
                say(text)
        follow()
        if dialogue.is_complete and not (reader.is_alive() or typed):
            dialogue.is_over = True

    with Host(master, place.open, final_frames=master.stop, say=say) as host:
        host.wait_until(lambda: dialogue.is_over, QUICK_S, go_on)
    dialogue.is_quit |= not dialogue.is_over


def _read(stdin: Any, lines: deque[str]) -> None:
    with suppress(OSError, ValueError):  # a terminal that has gone
        lines.extend(stdin)


def press_live(part: Arm, place: BusAddress, path: Path, force: float) -> bool:
    """Guide through presses of ``force`` (N, NaN: not known) on a bus; return whether they are complete.

    They are in the file at any time: after an interruption the same command goes on.
    """
    output.try_to_write(path)
    guide = PressGuide(part, force, _made_before(part, path, force))
    n_kept = len(guide.presses)

    def keep() -> None:
        nonlocal n_kept
        if len(guide.presses) != n_kept:
            n_kept = len(guide.presses)
            write_presses(path, part, guide.presses)

    talk(guide, part, place, Console(), keep)
    return guide.is_over and not guide.is_quit


def _made_before(part: Arm, path: Path, force: float) -> list[Press]:
    """Return the presses of an earlier run; a file of another make, or another force, is refused."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", errors="replace") as file:
        if next(csv.reader([file.readline()]), []) != columns_of(part):
            raise click.BadParameter(f"{path} was not made by `calibrate live`; give a new name")
    presses = read_presses(part, path)
    if any(not np.array_equal(press.force, force, equal_nan=True) for press in presses):
        raise click.BadParameter(f"{path} has presses of another force; give a new name")
    return presses
