"""What freshness and plausibility cost: ``python -m tests.bench.trust_cost`` runs a forearm, virtually.

The checks are timed in the cycles that they belong to, so load on the machine changes both sides alike. The
account of answers, which is kept while frames are decoded, is timed with and without, in turns. The latency
from SYNC to contacts is that of two masters on buses of their own, of which one has no checks, cycle by cycle
in turns; it holds the time on the wire, which is virtual, and the computing time.
"""

from __future__ import annotations

import sys
from time import perf_counter_ns

import numpy as np

from skinbus.can.frame import FrameBatch
from skinbus.master.gather import Gather
from tests.master.rig import Rig

CYCLES = 600


class Timed:
    """Adds up the time that some calls take."""

    def __init__(self):
        self.ns = 0

    def wrap(self, owner, name):
        call = getattr(owner, name)

        def timed(*args, **settings):
            begin = perf_counter_ns()
            try:
                return call(*args, **settings)
            finally:
                self.ns += perf_counter_ns() - begin

        setattr(owner, name, timed)


def account_ns(plan, n=2000):
    """Return what keeping the account adds to decoding the frames of a cycle, ns, the median of n."""
    batch, counts = FrameBatch(plan.n_frames), np.zeros(plan.n_tactels, np.int32)
    plan.pack(counts, batch)
    seen, answers = np.zeros(plan.n_patches, np.int32), plan.answers()
    took = np.zeros((2, n))
    for k in range(n):
        for with_account in (0, 1):
            answers.due[:] = 1
            begin = perf_counter_ns()
            plan.unpack(batch, counts, seen, None, None, answers if with_account else None)
            took[with_account, k] = perf_counter_ns() - begin
    return float(np.median(took[1]) - np.median(took[0]))


def bench(level):
    """Print the share of the checks in the compute time of a cycle at a level."""
    rig = Rig("forearm", level=level, stopwatch=perf_counter_ns)
    rig.run(1500)
    master, checks, outside = rig.master, Timed(), Timed()
    checks.wrap(master.cycle.plausibility, "judge")
    checks.wrap(master.freshness, "judge")
    checks.wrap(master.freshness, "drain")
    outside.wrap(master.freshness, "open")
    outside.wrap(master.freshness, "started")
    shares, totals = [], []
    account = account_ns(master.gather.plan)
    while len(shares) < CYCLES:
        checks.ns = outside.ns = 0
        n = len(rig.reports)
        rig.run(1e-6 * master.period_ns)
        if len(rig.reports) != n + 1:
            continue
        extra = checks.ns + outside.ns + account
        total = rig.reports[-1].compute_ns + outside.ns
        totals.append(total)
        shares.append(extra / (total - extra))
    print(
        f"{level}: cycle {np.median(totals) / 1e3:.0f} us; checks add {100 * np.median(shares):.1f} % "
        f"(account {account / 1e3:.1f} us)"
    )


def make_rig(level, *, has_checks):
    """Return a forearm that is pressed, and whose master takes all it gets for fresh and true, or not."""
    rig = Rig("forearm", level=level, stopwatch=perf_counter_ns)
    if not has_checks:
        master = rig.master
        none = np.zeros(master.arm.n_patches, np.bool_)
        master.gather = Gather(master.gather.plan, master.arm.n_tactels)
        master.cycle.plausibility.judge = lambda *args: None
        master.freshness.judge = lambda fresh: fresh
        master.freshness.open = lambda *args: False
        master.freshness.started = lambda *args: None
        master.freshness.drain = lambda *args: (none, none)
    rig.run(1500)
    return rig


def bench_latency(level):
    """Print the median latency with and without the checks, and that of their difference in pairs."""
    rigs = [make_rig(level, has_checks=has_checks) for has_checks in (False, True)]
    took = np.zeros((CYCLES, 2))
    for k in range(CYCLES):
        for side in (0, 1) if k % 2 else (1, 0):
            rigs[side].run(1e-6 * rigs[side].master.period_ns)
            took[k, side] = 1e-3 * rigs[side].reports[-1].latency_ns
    without, with_checks = np.median(took, axis=0)
    more = np.median(took[:, 1] - took[:, 0])
    print(
        f"{level}: SYNC to contacts {without:.0f} us without the checks, {with_checks:.0f} us with them; "
        f"in pairs {more:+.0f} us ({100 * more / without:+.1f} %)"
    )


if __name__ == "__main__":
    for name in sys.argv[1:] or ("kmeans", "fit", "full"):
        bench(name)
        bench_latency(name)
