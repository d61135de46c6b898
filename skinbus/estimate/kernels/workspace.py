"""The buffers of an estimator: everything a cycle writes to, made once per arm."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Floats, Ints
from skinbus.estimate.kernels.disc_shapes import KINDS
from skinbus.estimate.kernels.layout import Layout

PATCH_CLUSTERS = 16
"""Most clusters of one patch; 64 tactels cannot show more maxima apart."""
SPARE = 16
"""Contacts that the search may add beyond the clusters of an arm."""
GROUP = 10
"""Most contacts of a group."""
KEPT = 24
"""Hypotheses kept of a group: those that explain the readings are rarely more than ten."""

FREE, TOUCHED, HELD = 0, 1, 2
"""What a tactel feels: nothing, a touch, one that it has felt in the cycle before."""
NO_VALUE, VALUE, SATURATED = 0, 1, 2
"""State of a tactel in this cycle: no value, its pressure, or that the pressure is at least its limit."""
K, RANDOM, RANK = range(3)
"""Places in ``Work.options``: contacts of a touched patch, 0 to choose; whether starts are random; level."""


class Work(NamedTuple):
    """Buffers of a cycle; n = n_tactels, c = most clusters and contacts."""

    options: Ints  # (3,)
    pressure: Floats  # (n,) Pa, as handed in
    valid: Bools  # (n,) whether the reading is there
    felt: npt.NDArray[np.int8]  # (n,)
    p: Floats  # (n,) Pa, finite
    state: npt.NDArray[np.int8]  # (n,)
    active: Bools  # (n,) touched in this cycle
    held: Bools  # (n,) touched in the cycle before, too
    touched: Bools  # (n_patches,)
    pressed: Bools  # (n_patches,) for certain, whatever their offsets
    offset: Floats  # (n_patches,) Pa, the median of a touched patch, 0 of others
    offset_variance: Floats  # (n_patches,) Pa^2, prior of an offset that the search may fit; 0 for none
    label: Ints  # (n,) cluster of the tactel, -1 for none
    parent: Ints  # (n,) union-find over tactels, -1 for not met yet
    order: Ints  # (n,) scratch list of tactels
    sorted: Floats  # (n,) Pa, scratch
    member: Ints  # (n,) tactels of the contact being described
    starts: Ints  # (PATCH_CLUSTERS,) tactels where the clusters of a patch start
    random: Ints  # (1,) state of the generator of random starts
    work: Ints  # (5,) see ``budget``

    cluster_peak: Ints  # (c,) tactel of its largest pressure
    cluster_x: Floats  # (c,) m, developed about its patch
    cluster_y: Floats
    cluster_root: Ints  # (c,) union-find over clusters: those of one contact share a root
    border: Ints  # (16 c, 2) tactels where clusters of different patches meet
    first_of: Ints  # (c,) the first tactel of a root
    next_of: Ints  # (n,) the next tactel of the same root, -1 after the last

    n_contacts: Ints  # (1,)
    link: Ints  # (c,) columns of the contacts of this cycle
    place: Floats  # (c, 4) s, a (m), log force, size
    patch: Ints
    n_tactels: Ints
    level: Ints
    quality: Ints
    status: Ints
    residual: Floats
    covariance: Floats  # (c, 3, 3) of s, a, force
    amplitude: Floats  # (c,) A of its law
    alive: Bools  # (c,) False for contacts taken back
    group: Ints  # (c,) first contact of its group
    again: Bools  # (c,) whether the group of this first contact is to be solved


class Search(NamedTuple):
    """Buffers of the search of one group; n = n_tactels, g = GROUP contacts, m = 4 g unknowns, h = KEPT."""

    pitch: Floats  # (1,) m, median distance of nearest tactels
    dof: Ints  # (1,) unknowns of a contact: 4 (s, a, log force, size), 3 where the law has no sizes
    n_listed: Ints  # (1,)
    listed: Ints  # (n,) tactels that the group may reach
    outside: Floats  # (n,) Pa along listed: pressure of contacts outside the group
    variance: Floats  # (n,) Pa^2 along listed
    tail: Floats  # (n,) along listed: degrees of freedom of Student's t, 0 for Gaussian errors
    jacobian: Floats  # (n, m) along listed
    felt_by: Ints  # (n, g) contacts that reach the tactel, in rising order
    n_felt_by: Ints  # (n,)
    weight: Floats  # (n,) 1 / Pa^2; 0 where a reading is one-sided and satisfied
    tailed: Ints  # (1,) whether the errors of this search have tails whatever the law
    residual: Floats  # (n,) Pa along listed, less the offset of the board
    scratch: Floats  # (m,)
    normal: Floats  # (m, m)
    gradient: Floats  # (m,)
    factor: Floats  # (m, m)
    inverse: Floats  # (m, m)
    step: Floats  # (m,)
    theta: Floats  # (g, 4) contacts being solved
    trial: Floats  # (g, 4)
    kind: Ints  # (g,) kind of size of each
    rows: Ints  # (g,) rows of the group's contacts in the columns of ``Work``
    kind_share: Floats  # (KINDS,) prior share
    kind_mean: Floats  # (KINDS,) prior mean of u
    force_prior: Floats  # (2,) mean and standard deviation of log force
    offsets: Ints  # (1,) whether the offsets of boards are unknowns
    n_plans: Ints  # (1,)
    plan: Ints  # (16 (g + 1), 5) proposals of moves: two contacts that go, number of new ones, kind of each
    plan_theta: Floats  # (16 (g + 1), 2, 4) the new ones
    n_hypotheses: Ints  # (1,)
    h_theta: Floats  # (h, g, 4)
    h_kind: Ints  # (h, g)
    h_count: Ints  # (h,) contacts
    h_score: Floats  # (h,) log evidence
    h_chi2: Floats  # (h, 3) chi^2, number of its tactels, mean share of their variance that is not noise
    h_covariance: Floats  # (h, g, 4, 4) of the unknowns of each contact
    h_status: Ints  # (h,)
    h_done: Bools  # (h,) expanded


def make_workspace(lay: Layout) -> Work:
    """Return zeroed buffers for an arm."""
    n, sizes = len(lay.s), np.diff(lay.patch_start)
    m, c = len(sizes), int(np.minimum(sizes, PATCH_CLUSTERS).sum()) + SPARE
    of_cycle = {"options": 3, "starts": PATCH_CLUSTERS, "random": 1, "work": 5, "n_contacts": 1}
    of_patches = dict.fromkeys(("touched", "pressed", "offset", "offset_variance"), m)
    of_tactels = dict.fromkeys(["pressure", "valid", "felt", "p", "state", "active", "held", "label"], n)
    of_tactels |= dict.fromkeys(["parent", "order", "sorted", "member", "next_of"], n)
    shapes = of_cycle | of_patches | of_tactels
    tables = {"border": (16 * c, 2), "place": (c, 4), "covariance": (c, 3, 3)}
    return Work(**_zeros(Work, dict.fromkeys(Work._fields, c) | shapes | tables))


def make_search(lay: Layout) -> Search:
    """Return zeroed buffers for the groups of an arm."""
    n, g, m, h = len(lay.s), GROUP, 4 * GROUP, KEPT
    plans = 16 * (g + 1)
    of_group = dict.fromkeys(("pitch", "dof", "n_listed", "tailed", "offsets", "n_plans", "n_hypotheses"), 1)
    of_tactels = dict.fromkeys(("listed", "outside", "variance", "tail", "weight", "residual"), n)
    of_unknowns = dict.fromkeys(("scratch", "gradient", "step"), m)
    of_kinds = dict.fromkeys(("kind_share", "kind_mean"), KINDS)
    of_hypotheses = dict.fromkeys(("h_count", "h_score", "h_status", "h_done"), h)
    tables = {"jacobian": (n, m), "felt_by": (n, g), "theta": (g, 4), "trial": (g, 4), "kind": g, "rows": g}
    tables |= dict.fromkeys(("normal", "factor", "inverse"), (m, m))
    tables |= {"force_prior": 2, "plan": (plans, 5), "plan_theta": (plans, 2, 4), "h_chi2": (h, 3)}
    tables |= {"h_theta": (h, g, 4), "h_kind": (h, g), "h_covariance": (h, g, 4, 4), "n_felt_by": n}
    shapes = of_group | of_tactels | of_unknowns | of_kinds | of_hypotheses | tables
    return Search(**_zeros(Search, shapes))


def _zeros(of: type, shapes: dict[str, Any]) -> dict[str, Any]:
    """Return an array of zeros for each field of a tuple, of the type that the field has."""
    kinds = _hints(of)
    return {name: np.zeros(shape, get_args(get_args(kinds[name])[1])[0]) for name, shape in shapes.items()}


_hints = cache(get_type_hints)  # they take a third of the time of a new estimator
