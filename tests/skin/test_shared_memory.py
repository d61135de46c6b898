"""Shared memory: what is read is whole, whoever dies in whatever moment; names have one writer."""

import os
import signal
import subprocess
import sys
from contextlib import closing

import pytest

import skinbus
from skinbus.errors import ArgumentError, ShareError
from skinbus.skin.shared_memory import SLOTS, SharedReader, SharedWriter, path_of
from tests.skin.shared_processes import CRAFTED, LAYOUT, crafted_memory, is_whole, uniform

N_SNAPSHOTS = 10_000


@pytest.fixture
def name():
    name = f"test-{os.getpid()}"
    yield name
    path_of(name).unlink(missing_ok=True)


@pytest.fixture
def process(name):
    """Another process that writes as fast as it can."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.skin.shared_processes", "write", name], stdout=subprocess.PIPE
    )
    assert process.stdout.readline() == b"ready\n"
    yield process
    process.kill()
    process.communicate()


@pytest.mark.slow
def test_no_snapshot_is_torn_and_a_killed_writer_leaves_the_last_whole_one(name, process):
    with skinbus.attach(name) as skin:
        numbers = []
        while len(numbers) < N_SNAPSHOTS or len(set(numbers)) <= 100:  # both have run beside each other
            cycle = skin.latest()
            assert is_whole(cycle) or not cycle.number
            numbers.append(cycle.number)
        assert skin.is_running
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not skin.is_running
        assert is_whole(skin.latest())
    with closing(SharedWriter(name, LAYOUT)) as writer:  # the name of a dead writer is free
        writer.write(uniform(1))
        assert SharedReader(name).newest == 1


def test_a_cycle_half_written_is_not_read(name):
    """A writer that dies in the middle of a cycle: the slot is marked, the newest is the one before."""
    with closing(SharedWriter(name, LAYOUT)) as writer:
        for number in range(1, 4):
            writer.write(uniform(number))
        reader = SharedReader(name)
        before = reader.read(3).tobytes()
        with path_of(name).open("r+b") as file:  # what a writer does first, and no more
            header = file.read(64)
            first_slot, slot_bytes = (int.from_bytes(header[at : at + 4], "little") for at in (40, 36))
            file.seek(first_slot + 4 % SLOTS * slot_bytes)
            file.write((7).to_bytes(8, "little") + b"\xff" * 100)
        assert reader.newest == 3
        assert reader.read(3).tobytes() == before
        assert reader.read(4) is None


def test_a_slot_that_was_gone_round_is_not_read(name):
    with closing(SharedWriter(name, LAYOUT)) as writer:
        reader = SharedReader(name)
        for number in range(1, SLOTS + 3):
            writer.write(uniform(number))
        assert reader.read(2) is None
        assert reader.read(3) is not None


def test_a_name_has_one_writer_and_is_gone_with_it(name):
    writer = SharedWriter(name, LAYOUT)
    with pytest.raises(ShareError, match="in use"):
        SharedWriter(name, LAYOUT)
    reader = SharedReader(name)
    assert (reader.is_alive, reader.is_stopped) == (True, False)
    writer.close()
    writer.close()
    assert (reader.is_alive, reader.is_stopped) == (False, True)
    with pytest.raises(ShareError, match="does `skinbus run --share"):
        SharedReader(name)


def test_what_is_no_shared_skin_is_refused(name):
    path_of(name).write_bytes(bytes(4096))
    with pytest.raises(ShareError, match="version"):
        SharedReader(name)
    path_of(name).write_bytes(b"x")
    with pytest.raises(ShareError, match="version"):
        SharedReader(name)
    with pytest.raises(ArgumentError, match="no name"):
        SharedReader("../passwd")


MEMBERS = 136 + 32 * (len(LAYOUT.links) + len(LAYOUT.buses))
BAD_PATCH = [(MEMBERS + 4, 99), (MEMBERS + 8, 99), (MEMBERS + 12, (1 << 32) - 1)]


@pytest.mark.parametrize(("at", "value"), [*CRAFTED, *BAD_PATCH])
def test_a_crafted_header_ends_a_reader_soon(name, at, value):
    crafted_memory(name, at, value)
    with pytest.raises(ShareError), skinbus.attach(name) as skin:
        skin.latest()


def test_names_of_links_and_buses_and_the_table_of_patches_are_in_it(name):
    with closing(SharedWriter(name, LAYOUT)):
        layout = SharedReader(name).layout
    assert (layout.name, layout.links, layout.buses) == (LAYOUT.name, LAYOUT.links, LAYOUT.buses)
    assert layout.node_id.tolist() == LAYOUT.node_id.tolist()
    assert (layout.n_tactels, layout.period_ns) == (LAYOUT.n_tactels, LAYOUT.period_ns)
