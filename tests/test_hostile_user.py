"""Another local user stops neither a service that shares its cycles nor a reader, but by exhaustion.

Attacks run in a child process that has become ``nobody``.
"""

import fcntl
import multiprocessing
import os
import pwd
import signal
import socket
import struct
import subprocess
import sys
from contextlib import suppress

import pytest

import skinbus
from skinbus.config.system import load_arm
from skinbus.errors import ShareError
from skinbus.skin.cycle import SkinLayout
from skinbus.skin.shared_memory import SharedWriter, path_of
from tests.cli.patience import PATIENCE_S
from tests.files import put

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="becomes another user")

WRITE_LOCK = struct.pack("hhqqi4x", fcntl.F_WRLCK, 0, 0, 0, 0)


def attacks(path, state, pid):
    """Return what another user may try on shared memory, a state file and a process, by name."""
    return {
        "write": lambda: os.open(path, os.O_RDWR),
        "empty": lambda: os.open(path, os.O_WRONLY | os.O_TRUNC),
        "truncate": lambda: os.truncate(path, 0),
        "remove": lambda: os.unlink(path),
        "rename": lambda: os.rename(path, f"{path}-away"),
        "link": lambda: os.link(path, f"{path}-mine"),
        "replace": lambda: os.symlink("/dev/zero", path),
        "chmod": lambda: os.chmod(path, 0o666),
        "lock": lambda: fcntl.fcntl(os.open(path, os.O_RDONLY), fcntl.F_OFD_SETLK, WRITE_LOCK),
        "kill": lambda: os.kill(pid, signal.SIGKILL),
        "stop": lambda: os.kill(pid, signal.SIGSTOP),
        "priority": lambda: os.setpriority(os.PRIO_PROCESS, pid, 19),
        "memory": lambda: os.open(f"/proc/{pid}/mem", os.O_RDWR),
        "state": lambda: os.open(state, os.O_WRONLY),
        "beside the state": lambda: os.mkdir(f"{state}.new"),
    }


TAKEN = {
    "file": lambda path: path.write_bytes(bytes(1 << 16)),
    "file that anybody can write": lambda path: (path.write_bytes(bytes(4096)), path.chmod(0o666)),
    "huge file": lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_RDWR), 1 << 40),
    "socket": lambda path: socket.socket(socket.AF_UNIX).bind(str(path)),
    "fifo": lambda path: os.mkfifo(path, 0o666),
    "link": lambda path: path.symlink_to("/etc/passwd"),
    "folder": lambda path: path.mkdir(),
}


def as_nobody(tries):
    """Try functions (by name) as nobody; return the names of those that were not refused."""

    def run():
        nobody = pwd.getpwnam("nobody")
        os.setgroups([])
        os.setgid(nobody.pw_gid)
        os.setuid(nobody.pw_uid)
        for name, attack in tries.items():
            with suppress(OSError):
                attack()
                succeeded.put(name)
        succeeded.put(None)

    forking = multiprocessing.get_context("fork")
    succeeded = forking.SimpleQueue()
    process = forking.Process(target=run)
    process.start()
    names = list(iter(succeeded.get, None))
    process.join(PATIENCE_S)
    return names


@pytest.fixture
def name():
    name = f"hostile-{os.getpid()}"
    yield name
    for remove in (os.unlink, os.rmdir):
        with suppress(OSError):
            remove(path_of(name))


@pytest.mark.slow
def test_a_running_service_and_its_reader_go_on(name, tmp_path):
    state = put(tmp_path, "state.json", "{}")
    writer = [sys.executable, "-m", "tests.skin.shared_processes", "write", name, "0.005"]
    with subprocess.Popen(writer, stdout=subprocess.PIPE) as service:
        try:
            assert service.stdout.readline() == b"ready\n"
            with skinbus.attach(name) as skin:
                before = next(skin).number
                assert as_nobody(attacks(path_of(name), state, service.pid)) == []
                assert all(next(skin).number > before for _ in range(20))
                assert skin.is_running
        finally:
            service.kill()
    assert state.read_text() == "{}"


@pytest.mark.slow
@pytest.mark.parametrize("kind", TAKEN)
def test_a_name_that_was_taken_is_an_error_at_once_after_which_the_unit_tries_again(name, kind):
    assert as_nobody({kind: lambda: TAKEN[kind](path_of(name))}) == [kind]
    with pytest.raises(
        ShareError, match=r"of user nobody (is neither yours|is no plain file|cannot be opened)"
    ):
        skinbus.attach(name)
    if kind == "file":  # the same error, for a unit
        command = [sys.executable, "-m", "skinbus", "run", "pad", "--interface", "virtual", "--share", name]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
        assert (done.returncode, "of user nobody" in done.stderr) == (3, True), done.stderr
    else:
        with pytest.raises(ShareError, match="of user nobody"):
            SharedWriter(name, SkinLayout.of(load_arm("pad")))
