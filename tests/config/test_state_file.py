"""State that lasts: whatever is left of two generations, a whole one is read, or none."""

import os
from contextlib import suppress

import pytest

from skinbus.config.state_file import VERSION, StateFile
from tests.files import put

OLD = {"patches": {"/1": {"zero_Pa": [1.0, -2.5]}}, "contacts": [], "last_id": 3}
NEW = OLD | {"last_id": 4}


@pytest.fixture
def two(tmp_path):
    file = StateFile(tmp_path / "state")
    file.save(OLD)
    file.save(NEW)
    return file


def test_newest_generation_is_read_and_the_one_before_is_kept(two):
    assert two.load() == NEW
    assert StateFile(two.before).load() == OLD
    assert two.faults == []
    assert sorted(path.name for path in two.path.parent.iterdir()) == ["state", "state.1"]
    assert two.path.stat().st_mode & 0o777 == 0o600


def test_what_killed_writers_left_is_removed_at_the_next_start(two):
    (two.path.parent / ".state.4711.tmp").write_bytes(b"half")
    other = two.path.parent / ".state2.4711.tmp"
    other.write_bytes(b"of another file")
    assert two.load() == NEW
    assert {path.name for path in two.path.parent.iterdir()} == {"state", "state.1", other.name}


def test_cut_anywhere_the_generation_before_is_read(two):
    whole = two.path.read_bytes()
    for length in range(len(whole)):
        two.path.write_bytes(whole[:length])
        assert two.load() == OLD
        assert len(two.faults) == 1


def test_a_changed_byte_anywhere_is_found(two):
    whole = bytearray(two.path.read_bytes())
    for k in range(len(whole)):
        changed = whole.copy()
        changed[k] ^= 0x41
        two.path.write_bytes(changed)
        assert two.load() == OLD


def test_without_a_whole_generation_there_is_none(two):
    two.path.write_bytes(b"")
    two.before.write_bytes(b"\x00" * 1000)
    assert two.load() is None
    assert len(two.faults) == 2
    assert StateFile(two.path.with_name("other")).load() is None


def test_another_version_is_not_guessed_at(two):
    text = two.path.read_bytes()
    two.path.write_bytes(text.replace(f"state {VERSION} ".encode(), f"state {VERSION + 1} ".encode(), 1))
    assert two.load() == OLD
    assert "version" in two.faults[0]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_power_may_fail_at_any_step_of_a_save(two, monkeypatch, step):
    """Each call of the system in turn is the last one that was done."""
    real, calls = getattr(os, step), []

    def fail(*args):
        if len(calls) == last:
            raise KeyboardInterrupt
        calls.append(args)
        return real(*args)

    for last in range(3):
        calls.clear()
        monkeypatch.setattr(os, step, fail)
        with suppress(KeyboardInterrupt):
            two.save({"last_id": 100 + last})
        monkeypatch.setattr(os, step, real)
        assert two.load()["last_id"] in (4, 100, 101, 102)
        assert two.load() is not None


def test_a_folder_that_is_gone_leaves_no_half_file(tmp_path):
    file = StateFile(tmp_path / "gone" / "state")
    with pytest.raises(OSError, match="No such file"):
        file.save(NEW)
    assert file.load() is None


def test_no_link_is_followed(two):
    target = put(two.path.parent, "target", "theirs")
    two.path.with_name(f".state.{os.getpid()}.tmp").symlink_to(target)
    with pytest.raises(OSError, match=r"symbolic|levels"):
        two.save(OLD)
    assert target.read_text() == "theirs"
