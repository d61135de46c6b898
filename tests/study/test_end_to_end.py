"""The whole pipeline on the wire: what the study measures keeps the bound of the plan."""

import csv

import pytest
from click.testing import CliRunner

from skinbus.cli import group
from skinbus.study.end_to_end import measure_end_to_end, measure_on_change


@pytest.mark.parametrize("eds", ["skin-patch", "skin-patch-8bit"])
def test_pipeline_at_the_largest_rate_keeps_its_bound_and_finds_every_touch(eds):
    row = measure_end_to_end(6, eds, cycles=12)
    assert row.missed == 0
    assert row.cycles >= 11
    assert 0.0 < row.latency_mean_ms <= row.latency_max_ms <= row.bound_ms < 1e3 / row.rate_hz
    assert row.load_pct < 100.0
    assert row.position_median_mm < 2.0


def test_bytes_are_sooner_there_than_words():
    words, octets = (
        measure_end_to_end(4, eds, rate_hz=50, cycles=6) for eds in ("skin-patch", "skin-patch-8bit")
    )
    assert octets.latency_max_ms < 0.7 * words.latency_max_ms


@pytest.mark.parametrize("eds", ["skin-patch", "skin-patch-8bit"])
def test_patches_that_send_on_change_load_the_bus_less_and_find_the_same_touches(eds):
    sync = measure_end_to_end(8, eds, rate_hz=100, cycles=20)
    change = measure_on_change(8, eds, rate_hz=100, cycles=20)
    assert change.missed == sync.missed == 0
    assert change.load_pct < 0.3 * sync.load_pct
    assert change.latency_max_ms < sync.latency_max_ms
    assert change.position_median_mm < 2.0


@pytest.mark.slow
def test_command_writes_table_and_pictures(tmp_path):
    result = CliRunner().invoke(
        group, ["study", "end-to-end", "--out", str(tmp_path), "--patches", "1", "--cycles", "4"]
    )
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader((tmp_path / "end-to-end.csv").read_text().splitlines()))
    assert [(row["eds"], row["mode"]) for row in rows] == [
        (eds, mode) for eds in ("skin-patch", "skin-patch-8bit") for mode in ("sync", "change")
    ]
    assert (tmp_path / "latency-patches.png").exists()
    assert (tmp_path / "latency-patches.svg").exists()
