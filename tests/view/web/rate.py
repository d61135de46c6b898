"""Measures what a page of 126 boards costs: python -m tests.view.web.rate [BOARDS]

Pictures a second by the renderer's own counter in a headless Chromium with software rendering, and what the
server sends for a picture; twenty cycles a second change every tactel and three contacts.
"""

import os
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import viser
from websockets.sync.client import connect

from skinbus.config.system import load_arm
from skinbus.view.web.history import History
from skinbus.view.web.page import DRAW_S, Page, Settings
from tests.view.web.browser import chromium
from tests.view.web.cycles import MadeCycle

SIZES = {"1280 x 800": {"width": 1280, "height": 800}, "a phone": {"width": 390, "height": 844}}
SETTLE_S, MEASURE_S = 12.0, 10.0
RENDERED = """() => {
  const { frame, calls, triangles, points } = __viserTestpoints.rendererInfo.render;
  return [frame, calls, triangles, points, performance.now()];
}"""
"""What the renderer counts: pictures, and what the last one had; and the time, ms."""


def arm_of(n_boards, n_links=7):
    """Return an arm of cylinders, of two rings of boards each."""
    count = n_boards // (2 * n_links)
    text = '[arm]\nname = "many"\nrate_hz = 10.0\n'
    for k in range(n_links):
        text += f'[[link]]\nname = "link {k}"\nsurface = "cylinder"\nlength_mm = 104.0\n'
        text += f"radius_mm = {51.0 * count / (2.0 * np.pi):.4f}\n"
        for ring in range(2):
            text += f'[[ring]]\nlink = "link {k}"\ns_mm = {26.0 + 52.0 * ring}\ncount = {count}\n'
            text += f"first_node_id = {1 + (2 * k + ring) * count}\n"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "many.toml"
        path.write_text(text)
        return load_arm(str(path), check_load=False)


class Moving:
    """A follower whose cycles are made as they are drawn: the source costs next to nothing."""

    silent_s, error, has_ended, n_cycles = 0.0, None, False, 0

    def __init__(self, arm):
        self._arm, self.history = arm, History()
        self._rng = np.random.default_rng(1)
        self._begun = time.monotonic()

    def zero(self, patch):
        """Do nothing."""

    @property
    def newest(self):
        n = 1 + int((time.monotonic() - self._begun) / DRAW_S)
        if n > self.n_cycles:
            contacts = [
                {"id": k + 1, "link": 2 * k, "s": 0.05 + 0.03 * np.sin(0.1 * n + k), "force": 3.0}
                for k in range(3)
            ]
            pressures = self._rng.uniform(0.0, 30e3, self._arm.n_tactels)
            self.n_cycles = n
            self._cycle = MadeCycle(n, contacts, pressures=pressures, arm=self._arm)
            self.history.take(self._cycle)
        return self._cycle


def cpu_seconds(folder="/proc"):
    """Return the processor time of the processes of Chromium by their kind, s."""
    seconds = {}
    for pid in filter(str.isdigit, os.listdir(folder)):
        try:
            words = Path(folder, pid, "cmdline").read_bytes().replace(b"\0", b" ").split()
            fields = Path(folder, pid, "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if not words or b"chromium" not in words[0]:
            continue
        kind = next((w.decode()[7:] for w in words if w.startswith(b"--type=")), "browser")
        seconds[kind] = seconds.get(kind, 0.0) + (int(fields[11]) + int(fields[12])) / os.sysconf(
            "SC_CLK_TCK"
        )
    return seconds


def sent(port, seconds):
    """Return messages and bytes a second that a page gets."""
    protocol = [f"viser-v{viser.__version__}"]
    with connect(f"ws://127.0.0.1:{port}", subprotocols=protocol, max_size=None, compression=None) as link:
        n_messages = n_bytes = 0
        begun = time.monotonic()
        while (now := time.monotonic()) < begun + seconds + 2.0:
            try:
                data = link.recv(timeout=0.5)
            except TimeoutError:
                continue
            if now > begun + 2.0:
                n_messages, n_bytes = n_messages + 1, n_bytes + len(data)
        return n_messages / seconds, n_bytes / seconds


def main(n_boards=126, n_links=7):
    """Measure and print."""
    arm = arm_of(n_boards, n_links)
    page = Page(arm, Moving(arm), f"{arm.n_patches} boards", Settings(port=0))
    thread = threading.Thread(target=page.run)
    thread.start()
    try:
        print(f"{arm.n_patches} boards, {arm.n_tactels} tactels")
        begun, n_drawn, busy = time.monotonic(), page.n_drawn, time.process_time()
        messages, n_bytes = sent(page.port, MEASURE_S)
        drawn = (page.n_drawn - n_drawn) / (time.monotonic() - begun)
        share = (time.process_time() - busy) / (time.monotonic() - begun)
        print(
            f"server: {drawn:.1f} pictures, {messages:.1f} messages, {1e-3 * n_bytes:.0f} kB a second;"
            f" {100 * share:.0f} % of a core"
        )
        with chromium() as open_tab:
            for name, size in SIZES.items():
                for query in ("", "?fixedDpr=1"):
                    tab = open_tab(f"http://127.0.0.1:{page.port}/{query}", size)
                    time.sleep(SETTLE_S)
                    before, cpu = tab.page.evaluate(RENDERED), cpu_seconds()
                    time.sleep(MEASURE_S)
                    after, later = tab.page.evaluate(RENDERED), cpu_seconds()
                    span = 1e-3 * (after[4] - before[4])
                    rate = (after[0] - before[0]) / span
                    cpu = {kind: round((later[kind] - cpu.get(kind, 0.0)) / span, 2) for kind in later}
                    print(
                        f"browser {name}{query}: {rate:.1f} pictures a second, {after[1]} calls,"
                        f" {after[2]} triangles, {after[3]} points; cores {cpu}",
                        flush=True,
                    )
                    if tab.errors:
                        print(tab.errors[:3])
                    tab.page.close()
    finally:
        page.stop()
        thread.join()
        page.close()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
