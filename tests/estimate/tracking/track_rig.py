"""Contacts by hand for the tests of tracks, and a long run of the tracker that never leaves compiled code."""

import numpy as np

from skinbus.estimate import Contacts
from skinbus.estimate.tracking.state import LIFT, MAX_TRACKS
from skinbus.estimate.tracking.step import step
from skinbus.estimate.tracking.tracker import Tracker
from skinbus.jit import setup
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface

PERIOD_NS = 20_000_000
SURFACES = [Surface.cylinder(0.4, 0.05), Surface.plane(0.4, 0.4), Surface.cone(0.4, 0.05, 0.03)]


def make_arm():
    """A cylinder, a plane and a cone, with a patch at s = 0.1 and one at s = 0.3 on each."""
    links = [Link(surface.kind, surface) for surface in SURFACES]
    places = [(link, s) for link in range(len(links)) for s in (0.1, 0.3)]
    patches = [
        PlacedPatch(patch=Patch.default(), node_id=n + 1, link=link, s=s, a=0.0)
        for n, (link, s) in enumerate(places)
    ]
    return Arm("three surfaces", links, patches)


ARM = make_arm()


def contacts(*rows, covariance=None, quality=0):
    """Rows of (link, s, a) or (link, s, a, force); all have one quality."""
    table = np.array([(*row, 5.0)[:4] for row in rows], float).reshape(-1, 4)
    n, zeros = len(table), np.zeros(len(table), np.int64)
    link = table[:, 0].astype(np.int64)
    return Contacts(
        t_ns=0,
        link=link,
        s=table[:, 1],
        a=table[:, 2],
        force=table[:, 3],
        patch=2 * link + (table[:, 1] > 0.2),
        level=np.array(["kmeans"] * n),
        n_tactels=zeros + 4,
        quality=zeros + quality,
        status=zeros,
        width=np.ones(n),
        width_sd=np.zeros(n),
        residual=np.zeros(n),
        covariance=np.zeros((n, 3, 3)) if covariance is None else np.array(covariance, float),
    )


class Film:
    """A tracker and the frames of what it sees, one every 20 ms."""

    def __init__(self, **settings):
        self.tracker = Tracker(ARM, **settings)
        self.t_ns = 0

    def show(self, *rows, fresh=None, after_ns=PERIOD_NS, **more):
        self.t_ns += after_ns
        return self.tracker.update(contacts(*rows, **more), self.t_ns, fresh)


def run_long(n_steps, seed=1):
    """Run a tracker for many cycles over contacts that come, go, meet and jump; return what went wrong.

    The result is (step, code): code 0 all was well, 1 a factor of a covariance was not positive or not
    finite, 2 a covariance was not symmetric or had no positive diagonal, 3 two tracks had one identity.
    """
    tracker = Tracker(ARM)
    return _run_long(tracker._work_table, tracker._ground_table, n_steps, seed)


@setup
def _run_long(w, g, n_steps, seed):
    np.random.seed(seed)
    place = np.zeros((4, 5))  # link, s, a, force, on
    t_ns = 0
    for n in range(n_steps):
        t_ns += int(np.random.exponential(20e6))
        if n % 5000 == 4999:
            t_ns -= 10**9
        count = 0
        for m in range(4):
            if np.random.random() < 0.01:
                place[m, 4] = 1.0 - place[m, 4]
                place[m, 0] = np.random.randint(3)
                place[m, 1] = np.random.random() * 0.4
                place[m, 2] = (np.random.random() - 0.5) * 0.2
            place[m, 1] += np.random.normal() * 2e-3
            place[m, 2] += np.random.normal() * 2e-3
            place[m, 3] = 10.0 ** (2.0 * np.random.random() - 1.0)
            if place[m, 4] == 0.0:
                continue
            w.c_link[count] = int(place[m, 0])
            w.c_patch[count] = 0
            w.c_z[count, 0] = place[m, 1]
            w.c_z[count, 1] = place[m, 2]
            w.c_z[count, 2] = place[m, 3]
            # covariances of every size, singular ones among them
            size = 10.0 ** (-12.0 * np.random.random())
            for i in range(3):
                for j in range(3):
                    w.c_cov[count, i, j] = size if m < 2 or i == j else 0.0
            count += 1
        w.fresh[:] = np.random.random() < 0.9
        step(w, g, t_ns, count, 2, 10**9, 10**9)
        for i in range(MAX_TRACKS):
            if w.identity[i] == 0 or w.state[i] == LIFT:
                continue
            for j in range(5):
                if not 0.0 < w.D[i, j] < np.inf:
                    return n, 1
                for m in range(5):
                    if w.P[i, j, m] != w.P[i, m, j] or not 0.0 < w.P[i, j, j] < np.inf:
                        return n, 2
            for j in range(i):
                if w.identity[j] and w.id[j] == w.id[i]:
                    return n, 3
    return n_steps, 0
