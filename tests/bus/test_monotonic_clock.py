"""Clocks never go back, and know the time of the wall."""

from types import SimpleNamespace

from skinbus.bus.monotonic_clock import MonotonicClock


def test_a_machine_that_is_busy_while_the_clock_is_made_does_not_shift_the_time_of_day(monkeypatch):
    held_up_ns = [0, 7_000_000, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    now_ns = 0

    def look(epoch_ns):
        nonlocal now_ns
        now_ns += 100 + (held_up_ns.pop(0) if held_up_ns else 0)
        return epoch_ns + now_ns

    clocks = SimpleNamespace(monotonic_ns=lambda: look(0), time_ns=lambda: look(10**18))
    monkeypatch.setattr("skinbus.bus.monotonic_clock.time", clocks)
    assert abs(MonotonicClock().wall_ns(0) - 10**18) < 1000
