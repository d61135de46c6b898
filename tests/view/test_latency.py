"""Latency as a listener measures it, on cycles made by hand."""

import pytest

from skinbus.can.frame import Frame
from skinbus.view.latency import LatencyLog

MS = 1_000_000
SYNC, CONTACT, LAST_CONTACT, SUMMARY = 0x80, 0x681, 0x690, 0x1FF
HALF_BIN_MS = 0.15


def log_of(latencies_ms, period_ms=20.0, contact=CONTACT):
    """Feed cycles with these latencies, and the SYNC that ends the last."""
    log = LatencyLog(127)
    t = MS
    for latency in [0.0, *latencies_ms]:  # the first cycle has no period before it
        log.take([Frame(SYNC, b"\x01", t)])
        log.take([Frame(SUMMARY, bytes(8), t + MS), Frame(contact, bytes(8), t + round(latency * MS))])
        t += round(period_ms * MS)
    log.take([Frame(SYNC, b"\x01", t)])
    return log


def test_latency_is_from_sync_to_the_last_contact_of_its_cycle():
    log = log_of([5.0] * 10)
    log.take([Frame(CONTACT, bytes(8), 0), Frame(LAST_CONTACT, bytes(8), 0)])
    spread = log.spread(log.sync_to_contact)
    assert (spread["p50"], spread["max"]) == pytest.approx((5.0, 5.0), abs=2 * HALF_BIN_MS)
    assert log.n_cycles == 10


def test_touch_waits_up_to_a_period_for_its_sync():
    log = log_of([5.0] * 10, period_ms=20.0)
    spread = log.spread(log.touch_to_contact)
    assert spread["p50"] == pytest.approx(15.0, abs=2 * HALF_BIN_MS)
    assert spread["p95"] == pytest.approx(24.0, abs=2 * HALF_BIN_MS)
    assert spread["max"] == pytest.approx(25.0, abs=2 * HALF_BIN_MS)


def test_cycles_without_contacts_say_nothing():
    log = log_of([4.0] * 5, contact=0x500)
    assert log.n_cycles == 0
    assert log.spread(log.sync_to_contact) == {}
