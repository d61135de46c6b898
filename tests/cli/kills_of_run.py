"""`skinbus run` is killed at random on a bus where two fingers are held: each start finds them again."""

import os
import random
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import skinbus
from skinbus.config.state_file import StateFile
from skinbus.errors import ShareError
from skinbus.skin.cycle import Contact
from tests.cli.patience import PATIENCE_S
from tests.master.restarting import SCENE
from tests.own_bus import own_group

KEPT_S = 25.0
"""Contacts of a state that is 30 s old are not taken up: the last five are for the start."""
N_FINGERS = 2
N_CYCLES = 25
"""Whose forces are averaged: a quarter of a second on the pad."""


class Held(NamedTuple):
    """The fingers, as one start of the master published them."""

    ids: tuple[int, ...]
    force: np.ndarray
    sd: np.ndarray
    """Standard deviation that each contact claims for its force, N."""


def sd(contact: Contact) -> float:
    """Standard deviation of a force, N; a contact without one has that of a touch threshold."""
    return float(contact.covariance[2, 2]) ** 0.5 if contact.covariance is not None else 0.5


class KilledRuns:
    """A simulated bus, and one `skinbus run` after the other on it."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.rng = folder, random.Random(seed)
        (folder / "scene.toml").write_text(SCENE)
        self.bus = ["--interface", "udp_multicast", "--channel", own_group()]
        self.share = f"kills-{os.getpid()}"
        self.processes: list[subprocess.Popen[bytes]] = []

    def command(self, *args: str) -> subprocess.Popen[bytes]:
        """Start a command on the bus; its words are in a file of the folder."""
        with (self.folder / f"{args[0]}.txt").open("ab") as words:
            command = [sys.executable, "-m", "skinbus", *args, *self.bus]
            self.processes.append(subprocess.Popen(command, stdout=words, stderr=words))
        return self.processes[-1]

    def start(self) -> subprocess.Popen[bytes]:
        """Start a master."""
        return self.command("run", "pad", "--quiet", "--state", f"{self.folder}/state", "--share", self.share)

    def saved(self, run: subprocess.Popen[bytes]) -> Held:
        """Wait until the fingers that a master shows are in the state that is kept, and return them."""
        begin = time.monotonic()
        held = self.held(run)
        while sorted(contact["id"] for contact in self.state()["contacts"]) != [*held.ids]:
            assert time.monotonic() - begin < PATIENCE_S, "the state is not written"
            time.sleep(0.1)  # between two looks at a file of another process
            held = self.held(run)
        return held

    def state(self) -> dict[str, Any]:
        """Return the state that is kept; without one, as if of long ago."""
        return StateFile(self.folder / "state").load() or {"contacts": (), "saved": 0.0}

    def held(self, run: subprocess.Popen[bytes]) -> Held:
        """Wait until a master shows both fingers for a while, and return them."""
        begin = time.monotonic()
        while time.monotonic() - begin < PATIENCE_S:
            assert run.poll() is None, self.words()
            try:
                with skinbus.attach(self.share) as skin:
                    held = fingers(skin)
            except ShareError:  # not there yet, or that of the master before
                time.sleep(0.02)  # between two looks at another process
                continue
            return held
        raise AssertionError(f"no contacts in {PATIENCE_S} s: {self.words()}")

    def words(self) -> str:
        """What masters have written."""
        return (self.folder / "run.txt").read_text()


def fingers(skin: skinbus.Skin) -> Held:
    """Wait for cycles with both fingers; return identities, and means of forces and standard deviations."""
    forces, sds = [], []
    for cycle in skin:
        shown = sorted(cycle.contacts, key=lambda contact: contact.id)
        if len(shown) == N_FINGERS:
            forces.append([contact.force for contact in shown])
            sds.append([sd(contact) for contact in shown])
            if len(forces) == N_CYCLES:
                break
    return Held(tuple(contact.id for contact in shown), np.mean(forces, axis=0), np.mean(sds, axis=0))


def kill_often(n: int, seed: int, folder: Path) -> int:
    """Kill a master ``n`` times, every second time while it starts; return how many of these were judged.

    On a machine so busy that contacts were no longer taken up, or were lost before, a start is not judged.
    """
    runs, n_judged = KilledRuns(folder, seed), 0
    try:
        runs.command("sim", str(folder / "scene.toml"))
        first = runs.saved(runs.start())
        n_words = len(runs.words())
        for k in range(n):
            is_early = k % 2 == 1
            time.sleep(runs.rng.uniform(0.0, 3.0 if is_early else 1.0))  # when does not matter
            run = runs.processes.pop()
            run.kill()
            run.wait()
            saved_s = runs.state()["saved"]
            run = runs.start()
            if is_early:
                now = runs.held(run)
                was_starved = "readings-lost" in runs.words()[n_words:]
                if time.time() - saved_s > KEPT_S or was_starved:
                    first, n_words = runs.saved(run), len(runs.words())
                    continue
                n_judged += 1
                assert now.ids == first.ids
                assert (np.abs(now.force - first.force) <= 3.0 * np.maximum(first.sd, now.sd)).all()
    finally:
        for process in reversed(runs.processes):
            process.terminate()
            process.wait()
    return n_judged
