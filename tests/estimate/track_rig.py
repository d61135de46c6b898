"""Contacts by hand for the tests of tracks."""

import numpy as np

from skinbus.estimate import Contacts
from skinbus.estimate.tracking import Tracker
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


def contacts(*rows, covariance=None):
    """Rows of (link, s, a) or (link, s, a, force)."""
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
        quality=zeros,
        status=zeros,
        size=np.zeros(n),
        residual=np.zeros(n),
        covariance=np.zeros((n, 3, 3)) if covariance is None else np.array(covariance, float),
    )


class Film:
    """A tracker and the frames of what it sees, one every 20 ms."""

    def __init__(self, **settings):
        self.tracker = Tracker(ARM, **settings)
        self.t_ns = 0

    def show(self, *rows, fresh=None, after_ns=PERIOD_NS, age_ns=0, **more):
        self.t_ns += after_ns
        return self.tracker.update(contacts(*rows, **more), self.t_ns, fresh, age_ns)
