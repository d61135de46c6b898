"""The buffers of an estimator: everything a cycle writes to, made once per arm."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.layout import Layout

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

PATCH_CLUSTERS = 16
"""Most clusters of one patch; 64 tactels cannot show more maxima apart."""
GROUP = 12
"""Most contacts solved at once."""
RIVALS = 12
"""Other answers that are remembered; more than six have never been seen to matter."""
CELLS = 1536
"""Cells that a posterior is integrated over; one of average shape takes 300, one of two far modes 1000."""
SIZE_ANSWERS = 8
"""Fingertips, tips and thumbs, from two starts each; what a law was learned with; and that law widened."""
SPARE = 8
"""Contacts that may be found beyond the clusters of an arm."""

OWNED, CLEAR = 0.15, 5.0
"""A contact owns a touched tactel that reads this part of its largest, or this many sigma; not noise."""

FREE, TOUCHED, HELD = 0, 1, 2
"""What a tactel feels: nothing, a touch, one that it has felt in the cycle before."""
NO_VALUE, VALUE, SATURATED = 0, 1, 2
"""State of a tactel in this cycle: no value, its pressure, or that the pressure is at least its limit."""


class Work(NamedTuple):
    """Buffers; n = n_tactels, c = most clusters and contacts, g = contacts of one group."""

    p: Floats  # (n,) Pa, finite
    state: npt.NDArray[np.int8]  # (n,)
    n_gaps: Ints  # (1,) tactels without a value
    active: Bools  # (n,) touched in this cycle
    held: Bools  # (n,) touched in the cycle before, too
    touched: Bools  # (n_patches,)
    pressed: Bools  # (n_patches,) for certain, whatever their offsets
    shifted: Bools  # (n_patches,) an offset has been subtracted
    label: Ints  # (n,) cluster of the tactel, -1 for none
    parent: Ints  # (n,) union-find over tactels, -1 for not met yet
    order: Ints  # (n,) scratch list of tactels, or of patches
    starts: Ints  # (PATCH_CLUSTERS,) tactels where the clusters of a patch start
    random: Ints  # (1,) state of the generator of random starts

    cluster_patch: Ints  # (c,)
    cluster_peak: Ints  # (c,) tactel of its largest pressure
    cluster_x: Floats  # (c,) m, developed about its patch
    cluster_y: Floats
    cluster_root: Ints  # (c,) union-find over clusters: those of one contact share a root
    cluster_joined: Bools  # (c,) whether others were joined to this root
    cluster_hurried: Bools  # (c,) whether one contact or two was decided without a fit

    pair_a: Ints  # (16 c,) bordering clusters of different patches, or contacts near each other
    pair_b: Ints
    pair_saddle: Floats  # (16 c,) Pa, the lower of the two tactels where they meet
    pair_slope: Floats  # (16 c,) Pa, the higher of them; of contacts: distance by joint reach

    n_contacts: Ints  # (1,)
    link: Ints  # (c,) columns of the contacts of this cycle
    s: Floats
    a: Floats
    log_force: Floats
    width: Floats
    width_sd: Floats  # 0 where the size of what presses is no unknown
    patch: Ints
    n_tactels: Ints
    level: Ints
    quality: Ints
    status: Ints
    residual: Floats
    covariance: Floats  # (c, 3, 3) of s, a, force
    wider_by: Floats  # (c,) factor that a misfit puts on it
    alive: Bools  # (c,) False for contacts taken back
    integrated: Bools  # (c,) whether all its modes are in its posterior mean, nothing outside presses on it
    averaged: Bools  # (c,) whether its posterior mean is published in place of its mode
    mean: Floats  # (c, 3) s, a, log force of that mean; what others feel of a contact is its mode
    mean_covariance: Floats  # (c, 3, 3)
    evidence: Floats  # (c,) sum of (p/sigma)^2 of its tactels; enough, if one of them is held
    contact_reach: Floats  # (c,) m
    contact_near: Floats  # (c,) m, the same and what it may yet grow and move by
    by_s: Ints  # (c,) contacts in the order of link and s, as they were when groups were made
    s_before: Floats  # (c,) m, s at that time
    n_ordered: Ints  # (1,) how many there were
    near: Ints  # (c,) scratch list of contacts
    span: Floats  # (2,) m, the furthest of their reaches, and the furthest that one has moved since
    group: Ints  # (c,) first contact of the group; union-find while groups are made
    group_size: Ints  # (c,)
    turn: Ints  # (c,) groups in the order in which they are solved
    rank: Floats  # (c,) largest evidence of a contact of each group
    group_before: Ints  # (c,) the same of the groups before
    group_again: Bools  # (c,) whether the group is to be solved
    group_seen: Bools  # (c,) whether it is to be, as it has felt what others press on
    orphan: Ints  # (c,) the strongest tactel nearest to a contact that no contact explains, -1 for none

    members: Ints  # (g,) contacts of the group being solved
    listed_theta: Floats  # (g, 4) contacts for which the tactels were listed
    far_listed: Floats  # (g,) m, distance within which they were listed
    predicted: Floats  # (n,) Pa, along list
    base: Floats  # (n,) Pa, along list: prediction of another answer
    best: Floats  # (g, 4) contacts of the best answer so far
    path: Floats  # (g, 4) contacts a move starts from
    candidate: Floats  # (g, 4) contacts of the best move so far
    before: Floats  # (g, 4) contacts before they are widened
    wide: Floats  # (g, 4) the best of them widened
    rival_theta: Floats  # (RIVALS, g, 4) other answers with as many contacts
    rival_chi2: Floats  # (RIVALS,)
    n_rivals: Ints  # (1,)
    wider: Floats  # (4 g,) factor on the standard deviation of each parameter; 0 where a ridge was walked
    sized: Floats  # (SIZE_ANSWERS, g, 4) s, a, log force, size of contacts, of one prior of sizes each
    sized_moment: Floats  # (SIZE_ANSWERS, g, 4, 4) covariance of s, a, force, size
    moment: Floats  # (3, 3, 3) second moments about the top of a ridge: of two slices, of all
    match: Ints  # (g,) row of another answer that is the same contact
    rate: Floats  # (g,) scratch
    badness: Floats  # (g,) chi^2 around each contact of a path
    inverse: Floats  # (4 g, 4 g)
    work: Ints  # (5,) the budget of the cycle, see ``budget``

    member: Ints  # (n,) scratch list of the tactels of one contact
    list: Ints  # (n,) tactels of the group being solved
    listed_s: Floats  # (n,) m, along list: where they are
    listed_a: Floats
    listed_narrow: Floats  # (n,) along list: 1 / width of the response
    square: Floats  # (n,) m^2, along list: squared distance from the contact that is evaluated
    weight: Floats  # (n,) 1 / Pa^2, along list
    # (CELLS, 6) of a posterior: s, a, log mass, mean and variance of the log force, side (m) or, if final, 0
    cell: Floats
    # (n, 11) along list, for one cell: p per amplitude, its variance across it, misfit, distance, reading,
    # s and a from the tactel, a cone's amplitude, Pa^2 of no place, 1 over that, slope over distance
    cell_felt: Floats
    doubt: Floats  # (n,) Pa^2, along list: variance of what a law with a misfit profile leaves
    beside: Floats  # (n,) Pa^2, along list: variance of what other contacts press
    background: Floats  # (n,) Pa, along list: pressure from contacts outside the group
    owner: Ints  # (n,) along list: the contact whose law is carried on to this tactel, -1 for none
    theta: Floats  # (g, 4) s, a, log force, width
    trial: Floats  # (g, 4)
    far: Floats  # (g,) m, the longest reach of each contact under the laws of the listed tactels
    nearest_tactel: Ints  # (g,) the listed tactel that is nearest to each contact
    n_felt: Ints  # (g,) tactels that feel each contact
    felt_at: Ints  # (g, n) their places in list
    felt: Floats  # (g, n, 4) what they feel: row of the Jacobian, pressure
    counts: Floats  # (n,) along list: weight, 0 where the reading is one-sided and satisfied
    pull: Floats  # (n,) along list: weight times residual
    normal: Floats  # (4 g, 4 g) of s, a, log force of each contact, then of sizes
    gradient: Floats  # (4 g,)
    normal_trial: Floats
    gradient_trial: Floats
    factor: Floats  # (4 g, 4 g) L of L D L' below the diagonal
    pivot: Floats  # (4 g,) 1 / D
    step: Floats  # (4 g,)


def make_workspace(lay: Layout) -> Work:
    """Return zeroed buffers for an arm."""
    n = len(lay.s)
    sizes = np.diff(lay.patch_start)
    c = int(np.minimum(sizes, PATCH_CLUSTERS).sum()) + SPARE
    g, m = GROUP, 4 * GROUP

    def ints(size: int) -> Ints:
        return np.zeros(size, np.int64)

    def flags(size: int) -> Bools:
        return np.zeros(size, np.bool_)

    return Work(
        p=np.zeros(n),
        state=np.zeros(n, np.int8),
        n_gaps=ints(1),
        active=flags(n),
        held=flags(n),
        touched=flags(len(sizes)),
        pressed=flags(len(sizes)),
        shifted=flags(len(sizes)),
        label=ints(n),
        parent=ints(n),
        order=ints(n),
        starts=ints(PATCH_CLUSTERS),
        random=ints(1),
        cluster_patch=ints(c),
        cluster_peak=ints(c),
        cluster_x=np.zeros(c),
        cluster_y=np.zeros(c),
        cluster_root=ints(c),
        cluster_joined=flags(c),
        cluster_hurried=flags(c),
        pair_a=ints(16 * c),
        pair_b=ints(16 * c),
        pair_saddle=np.zeros(16 * c),
        pair_slope=np.zeros(16 * c),
        n_contacts=ints(1),
        link=ints(c),
        s=np.zeros(c),
        a=np.zeros(c),
        log_force=np.zeros(c),
        width=np.ones(c),
        width_sd=np.zeros(c),
        patch=ints(c),
        n_tactels=ints(c),
        level=ints(c),
        quality=ints(c),
        status=ints(c),
        residual=np.zeros(c),
        covariance=np.zeros((c, 3, 3)),
        wider_by=np.ones(c),
        alive=flags(c),
        integrated=flags(c),
        averaged=flags(c),
        mean=np.zeros((c, 3)),
        mean_covariance=np.zeros((c, 3, 3)),
        evidence=np.zeros(c),
        contact_reach=np.zeros(c),
        contact_near=np.zeros(c),
        by_s=ints(c),
        s_before=np.zeros(c),
        n_ordered=ints(1),
        near=ints(c),
        span=np.zeros(2),
        group=ints(c),
        group_size=ints(c),
        turn=ints(c),
        rank=np.zeros(c),
        group_before=ints(c),
        group_again=flags(c),
        group_seen=flags(c),
        orphan=ints(c),
        members=ints(g),
        listed_theta=np.ones((g, 4)),
        far_listed=np.zeros(g),
        predicted=np.zeros(n),
        base=np.zeros(n),
        best=np.ones((g, 4)),
        path=np.ones((g, 4)),
        candidate=np.ones((g, 4)),
        before=np.ones((g, 4)),
        wide=np.ones((g, 4)),
        rival_theta=np.ones((RIVALS, g, 4)),
        rival_chi2=np.zeros(RIVALS),
        n_rivals=ints(1),
        wider=np.ones(m),
        sized=np.zeros((SIZE_ANSWERS, g, 4)),
        sized_moment=np.zeros((SIZE_ANSWERS, g, 4, 4)),
        moment=np.zeros((3, 3, 3)),
        match=ints(g),
        rate=np.zeros(g),
        badness=np.zeros(g),
        inverse=np.zeros((m, m)),
        work=ints(5),
        member=ints(n),
        list=ints(n),
        listed_s=np.zeros(n),
        listed_a=np.zeros(n),
        listed_narrow=np.ones(n),
        square=np.zeros(n),
        weight=np.zeros(n),
        cell=np.zeros((CELLS, 6)),
        cell_felt=np.zeros((n, 11)),
        doubt=np.zeros(n),
        beside=np.zeros(n),
        background=np.zeros(n),
        owner=ints(n),
        theta=np.ones((g, 4)),
        trial=np.ones((g, 4)),
        far=np.zeros(g),
        nearest_tactel=ints(g),
        n_felt=ints(g),
        felt_at=np.zeros((g, n), np.int64),
        felt=np.zeros((g, n, 4)),
        counts=np.zeros(n),
        pull=np.zeros(n),
        normal=np.zeros((m, m)),
        gradient=np.zeros(m),
        normal_trial=np.zeros((m, m)),
        gradient_trial=np.zeros(m),
        factor=np.zeros((m, m)),
        pivot=np.zeros(m),
        step=np.zeros(m),
    )
