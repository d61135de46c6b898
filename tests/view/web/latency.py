"""Measures the latency of a master with and without five open pages, side by side.

    python -m tests.view.web.latency [--browser]

Simulated boards, `skinbus run --share` and `skinbus view --attach` are processes of their own. A page is a
connection that takes all that the server sends; with --browser a tab of Chromium, which also draws it.
"""

import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import numpy as np
import viser
from websockets.sync.client import connect

import skinbus
from skinbus.errors import ShareError
from tests.view.web.browser import chromium

NAME, PORT, CHANNEL = "view-latency", 8765, "239.74.163.57"
N_PAGES, N_PAIRS, PHASE_S, SETTLE_S = 5, 8, 4.0, 1.0


def process(stack, *words):
    """Run a command of skinbus until the stack is left."""
    command = [sys.executable, "-m", "skinbus", *words]
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    stack.callback(running.wait)
    stack.callback(running.terminate)


def attached():
    """Return the skin in shared memory when it is there."""
    for _ in range(600):
        try:
            return skinbus.attach(NAME)
        except ShareError:
            time.sleep(0.1)
    raise SystemExit("no master came up")


def take_all(link):
    """Take what a server sends until the connection ends."""
    for _ in link:
        pass


def open_pages(stack, open_tab):
    """Open the pages."""
    for _ in range(N_PAGES):
        if open_tab:
            stack.callback(open_tab(f"http://127.0.0.1:{PORT}/").page.close)
        else:
            protocol = [f"viser-v{viser.__version__}"]
            link = stack.enter_context(
                connect(f"ws://127.0.0.1:{PORT}", subprotocols=protocol, max_size=None, compression=None)
            )
            threading.Thread(target=take_all, args=(link,), daemon=True).start()


def measure(skin):
    """Return the latencies of the cycles of a phase, ms."""
    end, latencies, last = time.monotonic() + PHASE_S, [], 0
    while time.monotonic() < end:
        cycle = skin.latest()
        if cycle.number != last:
            last = cycle.number
            latencies.append(1e3 * cycle.latency_s)
        time.sleep(0.004)
    return np.array(latencies)


def main(in_browser):
    """Measure, and print the ratios."""
    with ExitStack() as stack:
        bus = ("--interface", "udp_multicast", "--channel", CHANNEL)
        process(stack, "sim", "forearm", *bus)
        process(stack, "run", "forearm", *bus, "--share", NAME, "--quiet")
        skin = stack.enter_context(attached())
        process(stack, "view", "forearm", "--attach", NAME, "--port", str(PORT))
        open_tab = stack.enter_context(chromium()) if in_browser else None
        while not skin.latest().number:
            time.sleep(0.1)
        time.sleep(8.0)
        pairs = []
        for _ in range(N_PAIRS):
            time.sleep(SETTLE_S)
            without = measure(skin)
            with ExitStack() as pages:
                open_pages(pages, open_tab)
                time.sleep(SETTLE_S)
                pairs.append((without, measure(skin)))
        again = [(a[: len(a) // 2], a[len(a) // 2 :]) for a, _ in pairs]
        for name, of in (("p50", 50), ("p95", 95), ("p99", 99)):
            ratios = [np.percentile(b, of) / np.percentile(a, of) for a, b in pairs]
            noise = [np.percentile(b, of) / np.percentile(a, of) for a, b in again]
            print(
                f"latency {name}: with {N_PAGES} pages / without: median {np.median(ratios):.3f}, "
                f"{min(ratios):.3f} to {max(ratios):.3f}; without / without: median {np.median(noise):.3f}, "
                f"{min(noise):.3f} to {max(noise):.3f}"
            )


if __name__ == "__main__":
    main("--browser" in sys.argv[1:])
