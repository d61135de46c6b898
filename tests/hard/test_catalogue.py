"""The table of hard cases, every level, law and surface: one test for each case and level."""

import pytest

from skinbus.estimate import LEVELS
from tests.hard.boards import BOARDS
from tests.hard.check import run_case
from tests.hard.ground import LAWS, SURFACES, Ground
from tests.hard.places import LAW, WHERE
from tests.hard.readings import READINGS

CASES = (*READINGS, *WHERE, *LAW, *BOARDS)
GROUNDS = [Ground(surface, law) for surface in SURFACES for law in LAWS]


@pytest.mark.parametrize("level", [*LEVELS[:2], pytest.param("full", marks=pytest.mark.slow)])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_what_must_hold_holds(case, level):
    outcomes = {ground: run_case(case, ground, level) for ground in GROUNDS}
    faults = [f"{g.surface}, {g.law}: {fault}" for g, o in outcomes.items() if o for fault in o.faults]
    assert not faults, "\n".join([case.holds, *faults])
    assert any(outcomes.values()), "a case that applies nowhere proves nothing"


def test_cases_have_names_of_their_own():
    assert len({case.name for case in CASES}) == len(CASES)
