"""The cache of compiled kernels is disposable: whatever happens to its files, the next start works."""

import os
import subprocess
import sys

import pytest

from skinbus.jit.kernel_files import KernelFolder, kernel_folder

USE_A_KERNEL = """
import logging
import numpy as np
from skinbus.bus.socketcan_batch import finish_kernel
from skinbus.jit import on_compile
compiled, octets, times = [], np.zeros(1, np.uint8), np.zeros(2, np.int64)
words = np.zeros((1, 8), np.int64)
with on_compile(lambda: compiled.append(1)):
    finish = finish_kernel()
    dropped = finish(np.zeros(1, np.uint32), octets, octets, octets, times, words, words, 0, 0, times, 123)
print(dropped, "compiled" if compiled else "loaded")
"""
NOBODY = 65534


def use_a_kernel(folder, *command, **environment):
    """What a process that needs one kernel writes to standard output, and to standard error."""
    done = subprocess.run(
        [*command, sys.executable, "-c", USE_A_KERNEL],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)} | environment,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.split(), done.stderr


def entries(folder):
    """The files of a cache, unfinished ones included."""
    return sorted(path for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def warm(tmp_path):
    """A cache with one kernel, and what the process that wrote it said."""
    assert use_a_kernel(tmp_path) == (["123", "compiled"], "")
    return tmp_path


@pytest.mark.slow
def test_damaged_entry_is_removed_and_compiled_anew_and_one_line_says_so(warm):
    (entry,) = entries(warm)
    sound = entry.read_bytes()
    flipped = bytearray(sound)
    flipped[len(sound) // 3] ^= 8
    for damaged in (b"", sound[: len(sound) // 2], sound + b"\0", bytes(flipped)):
        entry.write_bytes(damaged)
        assert KernelFolder(entry.parent).load(entry.stem) is None
        assert not entries(warm)
    entry.write_bytes(flipped)
    output, errors = use_a_kernel(warm)
    assert output == ["123", "compiled"]
    assert errors.count("\n") == 1
    assert "is damaged" in errors
    assert use_a_kernel(warm) == (["123", "loaded"], "")


def test_folder_that_others_can_write_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernel_folder.cache_clear()
    kernel_folder().path.chmod(0o777)
    kernel_folder.cache_clear()
    assert kernel_folder().path is None
    assert "can be written by other users" in kernel_folder().fault
    kernel_folder.cache_clear()


@pytest.mark.slow
def test_without_home_and_with_a_read_only_installation_kernels_are_compiled(tmp_path):
    environment = {"HOME": "/nonexistent", "XDG_CACHE_HOME": ""}
    command = []
    if os.geteuid() == 0:  # nobody, who may read everything: the interpreter may lie in root's home
        rights = "+dac_read_search"
        command = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
        command += [f"--inh-caps={rights}", f"--ambient-caps={rights}"]
    assert use_a_kernel("", *command, **environment) == (["123", "compiled"], "")


def test_full_disk_is_reported_once_and_kernels_are_compiled_without_a_cache(tmp_path, caplog, monkeypatch):
    folder = KernelFolder(tmp_path)
    monkeypatch.setattr(
        os, "fsync", lambda file: (_ for _ in ()).throw(OSError(28, "No space left on device"))
    )
    folder.save("a.b.c", b"x")
    folder.save("a.b.c", b"x")
    assert (folder.path, len(caplog.messages), entries(tmp_path)) == (None, 1, [])
