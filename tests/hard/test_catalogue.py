"""The table of hard cases, every level, law and surface: one test for each case and level."""

import itertools

import pytest

from skinbus.estimate import LEVELS
from tests.hard.catalogue import CASES
from tests.hard.check import run_case
from tests.hard.ground import LAWS, SURFACES, Ground

LONG = {
    (name, "fit")
    for name in (
        *("a dead row", "flat field over the whole arm", "ends of the counts by turns"),
        *("one stuck at full scale", "one stuck at full scale under the contact"),
    )
}
GROUNDS = [Ground(surface, law) for surface in SURFACES for law in LAWS]


def outcomes_of(name, level):
    """What a level makes of a case on every ground that has it."""
    must, build, *values = CASES[name]
    situations = {ground: build(ground, *values) for ground in GROUNDS}
    return {ground: run_case(must, it, level) for ground, it in situations.items() if it is not None}


@pytest.mark.parametrize(
    ("name", "level"),
    [
        pytest.param(name, level, marks=[pytest.mark.slow] * (level == "full" or (name, level) in LONG))
        for name, level in itertools.product(CASES, LEVELS)
    ],
)
def test_what_must_hold_holds(name, level):
    outcomes = outcomes_of(name, level)
    faults = [f"{g.surface}, {g.law}: {fault}" for g, o in outcomes.items() for fault in o.faults]
    assert not faults, "\n".join(faults)
    assert outcomes, "a case that applies nowhere proves nothing"
