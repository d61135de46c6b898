"""A person is guided through the presses of a calibration: wrong ones are named, and it ends in time."""

import pytest

from skinbus.estimate.calibration import judge
from skinbus.estimate.calibration.table import tables_of
from tests.master.commissioning.press_bench import FORCE_N, SEED, Bench


@pytest.mark.slow  # a minute of a board; the other tests press it a few times
def test_what_it_asked_for_calibrates_the_board_and_begun_again_it_asks_for_more():
    bench = Bench()
    while not bench.guide.is_over:
        bench.obey()
    assert len(bench.guide.presses) == 30
    assert bench.lines[-1] == "30 presses: that is enough."
    ((table, _),) = tables_of(bench.arm, bench.guide.presses)
    judgement = judge(table)
    assert not judgement.faults, judgement.faults
    assert judgement.place_error < 0.5e-3
    assert "[31/50]" in Bench(presses=bench.guide.presses).lines[-1]


@pytest.mark.slow
def test_wrong_presses_are_named_and_asked_for_again():
    bench = Bench(SEED + 1)
    first = bench.lines[-1]
    assert "[1/30] node 1: press at" in first
    s, a = bench.asked()
    for wrong, words in (
        (lambda: bench.press(s, a, ms=150), "too shortly"),
        (lambda: bench.press(s, a, force=0.9), "too lightly"),
        (lambda: bench.press(s + 0.015, a), "mm from there"),
    ):
        said = wrong()
        assert words in said[0], said
        assert said[-1] == first
    assert not bench.guide.presses
    reminder = bench.wait(21_000)
    assert "No press was felt" in reminder[0]
    assert reminder[1:] == [first]
    bench.obey()
    (made,) = bench.guide.presses
    assert (made.s, made.a, made.force) == (pytest.approx(s), pytest.approx(a), FORCE_N)
