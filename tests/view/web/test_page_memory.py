"""A page that is open for an hour takes no more memory; nothing else runs meanwhile, as all blocks count."""

import gc
import math
import sys
import threading

import numpy as np
import pytest

from skinbus.master.patches.table import PatchState
from skinbus.view.web.history import History
from skinbus.view.web.page import Page, Settings
from tests.cli.patience import TRIES
from tests.view.web import cycles

GROWTH = 100
"""Blocks in 200 draws: an object kept for every other one is seen, however often that is tried."""


class Hour:
    """Cycles of an hour, one in six seconds: contacts come and go, boards are lost and come back."""

    silent_s, error, has_ended, n_cycles = 0.0, None, False, 0

    def __init__(self):
        self.history, self.newest = History(), None

    def go_to(self, n):
        contacts = [{"id": 1 + (n + k) % 200, "s": 0.05, "a": 0.01 * k, "force": 2.0} for k in range(n % 4)]
        pressures = np.full(cycles.ARM.n_tactels, 100.0 * (n % 50))
        lost = {n % 24: PatchState.SILENT} if n % 3 else {}
        self.newest = cycles.MadeCycle(1 + 300 * n, contacts, states=lost, pressures=pressures)
        self.history.take(self.newest)


def settled():
    """Return how many blocks of memory Python has when the server's thread has sent what waits."""
    counts = [math.inf]
    for _ in range(200):
        gc.collect()
        counts.append(sys.getallocatedblocks())
        if counts[-1] >= counts[-2]:
            break
        threading.Event().wait(0.02)
    return min(counts)


@pytest.mark.slow
def test_page_that_is_open_for_an_hour_takes_no_more_memory():
    hour = Hour()
    page = Page(cycles.ARM, hour, "an hour", Settings(port=0))
    try:
        counts = []
        for n in range(200 * (2 + TRIES)):
            hour.go_to(n)
            page.update()
            if n % 200 == 199:  # what is made once is made in the first 400
                counts.append(settled())
                if len(counts) > 2 and counts[-1] - counts[-2] < GROWTH:  # else another thread made more
                    break
        assert counts[-1] - counts[-2] < GROWTH
    finally:
        page.close()
