"""The headline: an error that no wrong count can hide, and a decision that follows from it."""

import numpy as np
import pytest
from matplotlib.text import Text

from skinbus.model import Arm
from skinbus.model.patch import grid
from skinbus.study.headline import CONDITIONS, Point, cycle_error, measure_headline, n_points, with_bits
from skinbus.study.headline_figure import compose_headline, decide, draw_headline, write_decisions

PITCH = 0.01
PAD = Arm.single_patch(grid(4, 4, PITCH))


def error(touches, found):
    truth = np.array([[*touch, 5.0] for touch in touches])
    s, a = np.array(found).reshape(-1, 2).T
    return cycle_error(PAD.links[0].surface, truth, s, a, 0, PITCH)


@pytest.mark.parametrize(
    ("touches", "found", "is_error"),
    [
        ([(0.0, 0.0)], [(0.001, 0.0)], 0.001),
        ([(0.0, 0.0)], [], PITCH),
        ([(0.0, 0.0)], [(0.001, 0.0), (0.015, 0.0)], PITCH),  # one too many
        ([(0.0, 0.0), (0.015, 0.0)], [(0.007, 0.0)], PITCH),  # two merged
        ([(0.0, 0.0), (0.015, 0.0)], [(0.0, 0.012), (0.015, 0.0)], 0.012),  # the worst of both
    ],
)
def test_error_of_a_cycle_is_that_of_its_worst_touch_and_a_pitch_at_least_with_a_wrong_count(
    touches, found, is_error
):
    assert error(touches, found) == pytest.approx(is_error)


def point(**changes):
    usual = {
        "arm": "pad", "condition": CONDITIONS[0].name, "fingers": 1, "level": "fit", "bits": 16,
        "p50_mm": 0.1, "p95_mm": 0.3, "wrong_count_pct": 0.0, "bound_p95_mm": 0.2, "compute_p50_us": 10.0,
        "compute_p99_us": 20.0, "wire_ms": 3.0, "rate_hz": 50.0, "latency_ms": 13.0,
    }  # fmt: skip
    return Point(**(usual | changes))


def test_the_soonest_of_those_as_good_as_the_best_is_chosen():
    slow = point(bits=16, p95_mm=0.29, latency_ms=20.0)
    soon = point(bits=8, p95_mm=0.3, latency_ms=10.0)
    worse = point(level="kmeans", p95_mm=3.0, latency_ms=5.0)
    assert decide([slow, soon, worse]) is soon


def test_among_levels_that_are_all_a_pitch_off_the_one_that_counts_best_is_chosen():
    blind = point(level="fit", p95_mm=10.0, wrong_count_pct=50.0)
    best = point(level="full", p95_mm=11.0, wrong_count_pct=12.0, latency_ms=14.0)
    assert decide([blind, best]) is best


def test_boards_change_their_bits_and_nothing_else():
    narrow = with_bits(PAD, 8)
    assert narrow.patches[0].patch.transducer.bits == 8
    assert narrow.patches[0].eds == "skin-patch-8bit"
    assert with_bits(narrow, 16).patches[0].eds == "skin-patch"
    assert narrow.patches[0].patch.law is PAD.patches[0].patch.law


def test_no_label_lies_on_another_or_on_a_legend():
    times = (8.9, 9.0, 9.1, 9.1, 9.2, 14.0)  # most of them nearer than a label is wide
    shares = (62.0, 58.0, 29.0, 7.0, 28.0, 11.0)
    figure = compose_headline(
        [
            point(condition=c.name, fingers=n, latency_ms=ms, wrong_count_pct=share, level=level, p95_mm=p95)
            for c in CONDITIONS
            for n, p95 in ((1, 0.3), (2, 10.0))
            for level, ms, share in zip(2 * ("kmeans", "fit", "full"), times, shares, strict=True)
        ]
    )
    figure.draw_without_rendering()
    for axes in figure.axes:
        labels = [Text.get_window_extent(text) for text in axes.texts]  # without their lines
        assert len(labels) == len(times) + 1
        marks = [axes.transData.transform(line.get_xydata())[0] for line in axes.lines[: len(times)]]
        for k, box in enumerate(labels):
            assert not any(
                box.overlaps(other) for other in [*labels[:k], axes.get_legend().get_window_extent()]
            )
            assert not any(box.contains(*mark) for mark in marks)
            assert axes.bbox.containsx(box.x0)
            assert axes.bbox.containsx(box.x1)


@pytest.mark.slow
def test_points_of_an_arm_become_a_picture_and_a_table(tmp_path):
    points = measure_headline(PAD, trials=20)
    assert len(points) == n_points()
    best = min(p.p95_mm for p in points if p.fingers == 1 and p.condition == CONDITIONS[0].name)
    assert best < 1e3 * PITCH / 2
    files = draw_headline(points, tmp_path)
    assert all(file.stat().st_size > 10_000 for file in files)
    assert write_decisions(points).count("\n| ") == 4
