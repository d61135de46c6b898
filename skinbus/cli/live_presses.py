"""Dialogues about presses on a bus."""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.cli.console import Console
from skinbus.cli.host import QUICK_S, Host, compiling
from skinbus.master.commissioning.press_dialogue import PressDialogue
from skinbus.master.commissioning.unplaced_boards import QuietMaster
from skinbus.model import Arm
from skinbus.skin.addresses import BusAddress


def talk(
    dialogue: PressDialogue,
    arm: Arm,
    place: BusAddress,
    console: Console,
    follow: Callable[[], Any] = tuple,
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
    threading.Thread(target=_read, args=(sys.stdin, typed), name="typed lines", daemon=True).start()
    say = partial(console.print, soft_wrap=True)
    with compiling(console):
        master = QuietMaster(arm, lambda *cycle: cycles.append(cycle))

    def go_on() -> None:
        while cycles and not dialogue.is_over:
            answers = [typed.popleft() for _ in range(len(typed))]
            for text in dialogue.step(*cycles.popleft(), answers):
                say(text)
        follow()

    with Host(master, place.open, final_frames=master.stop, say=say) as host:
        host.wait_until(lambda: dialogue.is_over, QUICK_S, go_on)
    dialogue.is_quit |= not dialogue.is_over


def _read(stdin: Any, lines: deque[str]) -> None:
    with suppress(OSError, ValueError):  # a terminal that has gone
        lines.extend(stdin)
