"""The table of hard cases, every level, law and surface: one test for each case and level."""

import numpy as np
import pytest

from skinbus.estimate import LEVELS, Estimator
from tests.hard.catalogue import CASES
from tests.hard.check import run_case
from tests.hard.ground import LAWS, SURFACES, Ground

GROUNDS = [Ground(surface, law) for surface in SURFACES for law in LAWS]


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_what_must_hold_holds(case, level):
    outcomes = {ground: run_case(case, ground, level) for ground in GROUNDS}
    faults = [f"{g.surface}, {g.law}: {fault}" for g, o in outcomes.items() if o for fault in o.faults]
    assert not faults, "\n".join([case.holds, *faults])
    assert any(outcomes.values()), "a case that applies nowhere proves nothing"


def test_cases_have_names_of_their_own():
    assert len({case.name for case in CASES}) == len(CASES)


@pytest.mark.parametrize("ground", [Ground("plane", "cone"), Ground("cylinder", "radial")], ids=str)
def test_nothing_that_an_earlier_cycle_left_is_read(ground):
    for case in CASES:
        situation = case.build(ground)
        if situation is None:
            continue
        estimator = Estimator(situation.arm, "full")
        first = estimator.update(situation.pressures, 0, situation.valid)
        for name, column in estimator._work._asdict().items():
            if name not in ("work", "random"):  # the budget, and the state that is to go on
                column[...] = {"f": np.nan, "b": True}.get(column.dtype.kind, 3)
        again = estimator.update(situation.pressures, 0, situation.valid)
        for name in ("link", "s", "a", "force", "patch", "quality", "status", "width", "covariance"):
            assert np.array_equal(getattr(first, name), getattr(again, name)), (case.name, name)
