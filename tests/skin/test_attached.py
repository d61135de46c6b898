"""A skin in shared memory is the skin that was written, and says when its writer has gone."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

import skinbus
from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.errors import ShareError
from skinbus.skin.feed import KEPT
from skinbus.skin.shared_memory import SLOTS, SharedWriter, path_of
from tests.cli.patience import PATIENCE_S
from tests.skin.scenes import write
from tests.skin.shared_processes import LAYOUT, is_whole, uniform


@pytest.fixture
def writer():
    name = f"attached-{os.getpid()}"
    writer = SharedWriter(name, LAYOUT)
    writer.name = name
    yield writer
    writer.close()
    path_of(name).unlink(missing_ok=True)


def test_what_is_read_is_what_was_written(tmp_path):
    name = f"same-{os.getpid()}"
    with skinbus.simulate(write(tmp_path)) as skin:
        first = skin.latest()
        writer = SharedWriter(name, first.layout)
        with skinbus.attach(name) as attached:
            assert attached.latest().number == 0
            for cycle in skin:
                writer.write(cycle)
                copy = attached.latest()
                assert copy.records.tobytes() == cycle.records.tobytes()
                assert copy.patch_records.tobytes() == cycle.patch_records.tobytes()
                assert copy.readings.valid.tolist() == cycle.readings.valid.tolist()
                assert copy.readings_of(1).valid.tolist() == copy.readings.valid.tolist()
                assert copy.readings.pressures == pytest.approx(cycle.readings.pressures, rel=1e-7)
                assert (copy.t_ns, copy.counter, copy.level) == (cycle.t_ns, cycle.counter, cycle.level)
                assert [c.point.tolist() for c in copy.contacts] == [c.point.tolist() for c in cycle.contacts]
            assert attached.links == skin.links
            writer.close()
            assert list(attached)[-1].number == copy.number


def test_attaching_waits_for_a_writer_that_has_not_begun():
    name = f"late-{os.getpid()}"
    with ThreadPoolExecutor(1) as pool:
        attached = pool.submit(skinbus.attach, name, timeout_s=PATIENCE_S)
        writer = SharedWriter(name, LAYOUT)
        with attached.result() as skin:
            writer.write(uniform(1))
            assert next(skin).number == 1
        writer.close()
    with pytest.raises(ShareError, match="no shared memory"):
        skinbus.attach(f"never-{os.getpid()}", timeout_s=0.05)


def test_cycles_come_in_order_and_lost_ones_are_counted(writer):
    with skinbus.attach(writer.name) as skin:
        for number in range(1, 6):
            writer.write(uniform(number))
        assert [next(skin).number for _ in range(5)] == [1, 2, 3, 4, 5]
        for number in range(6, 40):
            writer.write(uniform(number))
        cycle = next(skin)
        assert is_whole(cycle)
        assert cycle.number > 39 - SLOTS
        assert skin.n_lost == cycle.number - 6
        assert KEPT > SLOTS


def test_a_writer_that_ended_is_seen_at_once_and_by_age(writer):
    writer.write(uniform(1))
    with skinbus.attach(writer.name) as skin:
        assert skin.is_running
        writer.close()
        assert not skin.is_running
        cycle = skin.latest()
        assert cycle.number == 1
        assert 0.0 < cycle.age_s <= (MonotonicClock().now_ns() - cycle.t_ns) * 1e-9
        assert [c.number for c in skin] == [1]


@pytest.mark.slow
def test_of_a_writer_that_has_died_the_newest_cycle_stays_and_one_that_runs_is_waited_for():
    name = f"dead-{os.getpid()}"
    script = "import os, sys; from tests.skin.shared_processes import *; "
    script += "SharedWriter(sys.argv[1], LAYOUT).write(uniform(1)); os._exit(0)"  # without closing it
    subprocess.run([sys.executable, "-c", script, name], check=True, timeout=PATIENCE_S)
    with skinbus.attach(name, timeout_s=0.05) as skin:
        assert skin.latest().number == 1
        assert not skin.is_running
        with pytest.raises(ShareError, match="has died"):
            list(skin)
    with ThreadPoolExecutor(1) as pool:
        attached = pool.submit(skinbus.attach, name, timeout_s=PATIENCE_S)
        writer = SharedWriter(name, LAYOUT)
        with attached.result() as skin:
            assert skin.is_running
        writer.close()
    path_of(name).unlink(missing_ok=True)
