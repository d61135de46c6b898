"""What another user can do to shared memory: `nobody` attacks a writer and a reader of root's."""

import os
import stat
import subprocess
import sys
from textwrap import dedent

import pytest

from skinbus.errors import ShareError
from skinbus.skin.shared_memory import SharedReader, SharedWriter, path_of
from tests.skin.shared_processes import LAYOUT, uniform

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")

TAKEN = {
    "file": "open(path, 'wb').write(bytes(4096))",
    "file that anybody can write": "open(path, 'wb').write(bytes(4096)); os.chmod(path, 0o666)",
    "huge file": "open(path, 'wb').truncate(1 << 40)",
    "FIFO": "os.mkfifo(path)",
    "link": "os.symlink('/etc/passwd', path)",
    "folder": "os.mkdir(path)",
    "socket": "socket.socket(socket.AF_UNIX).bind(path)",
}
ATTACKS = """
    done = []
    def attack(what, *words):
        try:
            what(*words)
        except OSError:
            return
        done.append(what.__name__)
    for flags in (os.O_RDWR, os.O_WRONLY | os.O_TRUNC):
        attack(os.open, path, flags)
    attack(os.truncate, path, 0)
    attack(os.unlink, path)
    attack(os.rename, path, path + '-mine')
    attack(os.chmod, path, 0o666)
    attack(os.link, path, path + '-mine')
    attack(os.kill, int(sys.argv[2]), 9)
    lock = struct.pack('hhqqi4x', fcntl.F_RDLCK, 0, 0, 0, 0)  # would be taken for the writer's
    attack(fcntl.fcntl, os.open(path, os.O_RDONLY), 37, lock)
    print(done, flush=True)
    sys.stdin.read()
"""


BECOME_NOBODY = """
import fcntl, os, pwd, socket, struct, sys
nobody = pwd.getpwnam('nobody')
os.setgroups([])
os.setgid(nobody.pw_gid)
os.setuid(nobody.pw_uid)
path = sys.argv[1]
"""


def as_nobody(code, *words):
    """A process of the user nobody that runs code; its input ends it."""
    return subprocess.Popen(
        [sys.executable, "-c", BECOME_NOBODY + dedent(code), *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def name():
    name = f"other-{os.getpid()}"
    path = path_of(name)
    yield name
    if os.path.lexists(path):
        path.rmdir() if stat.S_ISDIR(path.lstat().st_mode) else path.unlink()


@pytest.mark.parametrize("what", TAKEN)
def test_a_name_that_nobody_has_taken_is_an_error_that_names_him(name, what):
    process = as_nobody(TAKEN[what], str(path_of(name)))
    process.communicate(timeout=60)
    assert process.returncode == 0
    for use in (lambda: SharedReader(name), lambda: SharedWriter(name, LAYOUT)):
        with pytest.raises(ShareError, match="of user nobody"):
            use()


def test_what_nobody_does_stops_neither_writer_nor_reader(name):
    writer = SharedWriter(name, LAYOUT)
    writer.write(uniform(1))
    process = as_nobody(ATTACKS, str(path_of(name)), str(os.getpid()))
    try:
        assert process.stdout.readline() == "[]\n"
        reader = SharedReader(name)
        writer.write(uniform(2))
        assert reader.is_alive
        assert reader.read(2) is not None
        writer.close()
        assert reader.is_stopped
    finally:
        process.communicate()
