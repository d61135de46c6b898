"""The firmware of a board as a core: its C, compiled on this machine, with the face of a Device."""

import ctypes as c
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import LONG, REMOTE_ID, RTR, Frame
from skinbus.firmware import write_project
from skinbus.node.layout import ImageLayout, key_of
from skinbus.objects.cia import NmtState
from skinbus.objects.eds import load_eds
from skinbus.objects.guard import GFC_ID

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror")
PAGE, SLOT = 8192, 65536 + 16
FLAGS = (*WARNINGS, "-DSB_PERIOD_US=0", f"-DSB_PROGRAM_BYTES={SLOT}")
EMPTY = b"\xff" * 2 * (PAGE + SLOT)
PORT = Path(__file__).parent / "library.c"
ALWAYS = 2**32 - 1
ROOM = 64
HOOK = c.CFUNCTYPE(c.c_uint32, c.c_void_p, c.c_uint16, c.c_uint8, c.POINTER(c.c_uint8))


def build(project, *flags):
    """Compile the core of a project with the port for tests; return the library."""
    sources = [*sorted((project / "core").glob("*.c")), project / "board.c", PORT]
    library = project / "library.so"
    command = ["cc", *FLAGS, *flags, "-shared", "-fPIC", f"-I{project}", f"-I{project / 'core'}"]
    done = subprocess.run([*command, "-o", library, *sources], capture_output=True, text=True)
    assert not done.returncode, done.stderr
    return library


class Code:
    """A compiled library and the types of its functions."""

    def __init__(self, path, layout):
        class SbFrame(c.Structure):
            _fields_ = (
                *(("id", c.c_uint16), ("flags", c.c_uint8), ("length", c.c_uint8)),
                *(
                    ("expires", c.c_bool),
                    ("t_us", c.c_uint32),
                    ("data", c.c_uint8 * (layout.max_pdo_bits // 8)),
                ),
            )

        class Library(c.Structure):
            _fields_ = (
                *(("n_writes", c.c_uint32), ("n_out", c.c_uint32)),
                *(("age_100us", c.c_uint16), ("status", c.c_uint8), ("is_restarting", c.c_bool)),
                *(("readings", c.c_int16 * len(readings_of(layout))), ("out", SbFrame * ROOM)),
            )

        self.frame_type, self.library_type, self.layout = SbFrame, Library, layout
        self.own = library = c.CDLL(str(path))
        for name, result in (
            *(("library_size", c.c_size_t), ("library_init", c.c_void_p)),
            *((name, c.c_uint32) for name in ("sb_get", "library_state", "sb_poll")),
            *((name, c.c_bool) for name in ("sb_request", "sb_error", "sb_error_end", "sb_set", "sb_guards")),
        ):
            getattr(library, name).restype = result


def readings_of(layout):
    """Return the sub-indices of the readings of a board."""
    return layout.subs(next(i for i in (0x6401, 0x6400) if i in layout.indices))


@cache
def code_of(eds, *flags):
    """Compile the firmware of an EDS, once."""
    with tempfile.TemporaryDirectory() as folder:
        write_project(eds, Path(folder))
        return Code(build(Path(folder), *flags), ImageLayout(load_eds(eds, 1), 1))


def five(data):
    return None if data is None else bytes(data[:5]).ljust(5, b"\0")


class FirmwareDevice(Core):
    """One board.

    Args:
        code: its firmware.
        node_id: 1..127, or 255.
        flash: two pages and two slots for programs; kept over a loss of power by whoever keeps them. None: it
            cannot store.
        n_writes: words of flash that can be written before the supply fails.
    """

    def __init__(self, code, node_id, *, serial=0, flash=None, n_writes=ALWAYS):
        self.code, self.library = code, code.own
        self.layout = code.layout
        self.flash = flash
        self._memory = c.create_string_buffer(self.library.library_size())
        self._face = code.library_type.from_buffer(self._memory)
        place = None if flash is None else c.c_void_p(c.addressof(c.c_char.from_buffer(flash)))
        self._start = node_id, serial, place, c.c_size_t(PAGE if flash else 0)
        self._face.n_writes = n_writes
        self._power_on()
        self._out = self._face.out
        self.readings = np.ctypeslib.as_array(self._face.readings)
        self._ids, self._ids_seen, self._cob_ids = (c.c_uint16 * 256)(), b"-", frozenset()
        self._hook = HOOK()
        self.age = np.zeros(1, np.uint16)
        """Of the next samples, 100 us."""
        self._status = 0

    def _power_on(self):
        self._at = c.c_void_p(self.library.library_init(self._memory, *self._start))

    @property
    def nmt_state(self):
        return NmtState(self.library.library_state(self._at) & 0xFF)

    @property
    def node_id(self):
        return self.library.library_state(self._at) >> 8

    runs_freely = False
    """The shipped boards send on SYNC."""

    @property
    def guards(self):
        return self.library.sb_guards(self._at)

    def sampled(self, age_ns):
        """The firmware looks at its samples by itself."""

    @property
    def cob_ids(self):
        n = self.library.library_ids(self._at, self._ids)
        ids = bytes(self._ids)[: 2 * n]
        if ids != self._ids_seen:
            self._ids_seen = ids
            self._cob_ids = frozenset(REMOTE_ID | (i & 0x7FFF) if i & 0x8000 else i for i in self._ids[:n])
        return self._cob_ids

    @property
    def sample_status(self):
        return 0

    @sample_status.setter
    def sample_status(self, status):
        self._status = int(status)

    def stop_readings(self, is_stopped):
        self._status = int(is_stopped)

    @property
    def on_write(self):
        return self._hook

    @on_write.setter
    def on_write(self, hook):
        def ask(_, index, sub, data):
            entry = self.layout.entries[key_of(index, sub)]
            return hook(index, sub, entry.decode(bytes(data[: entry.size]))) or 0

        self._hook = HOOK(ask)
        self.library.library_on_write(self._at, self._hook)

    def image_view(self, index, sub, n):
        if index == 0x2070:
            return self.age
        return self.readings[sub - 1 : sub - 1 + n]

    def view_of(self, name, n):
        return self.age

    def get(self, index, sub=0):
        return self.library.sb_get(self._at, index, sub)

    def set(self, index, sub, value):
        entry = self.layout.entries[key_of(index, sub)]
        if index in (0x6401, 0x6400) and sub:
            self.readings[sub - 1] = value
        data = entry.encode(value)
        assert self.library.sb_set(self._at, index, sub, data, len(data))

    def emcy(self, code, data=b""):
        return self.library.sb_error(self._at, code, 0, five(data))

    def emcy_clear(self, code, data=None):
        return self.library.sb_error_end(self._at, code, five(data))

    def transmit_tpdo(self, number):
        return self.library.sb_request(self._at, 0x17FF + number)

    def command(self, command):
        self.library.sb_command(self._at, command)

    def step(self, now_ns, frames=()):
        now_us = now_ns // 1000
        took = []
        self._face.status, self._face.age_100us = self._status, int(self.age[0])
        for frame in frames:
            if frame.flags not in (0, RTR) and frame.flags != LONG:
                continue  # a port does not pass on others
            data = frame.data[: len(self._out[0].data)]
            own = self.code.frame_type(
                frame.can_id, 1 if frame.flags == RTR else 2 * bool(frame.flags), len(data), False,
                frame.t_ns // 1000 & 0xFFFFFFFF, type(self._out[0].data)(*data),
            )  # fmt: skip
            self.library.sb_receive(self._at, c.byref(own), now_us & 0xFFFFFFFF)
            self._take(now_ns, took)
        wait = self.library.sb_poll(self._at, now_us & 0xFFFFFFFF)
        if self._face.is_restarting:
            self._power_on()
            wait = self.library.sb_poll(self._at, now_us & 0xFFFFFFFF)
        self._take(now_ns, took)
        took.sort(key=lambda frame: frame.can_id != GFC_ID)  # it has a mailbox of its own, and wins
        return Step(took, [], NEVER if wait == 2**32 - 1 else (now_us + wait) * 1000)

    def _take(self, now_ns, took):
        for frame in self._out[: self._face.n_out]:
            flags = LONG if frame.length > CLASSIC_BYTES else 0
            took.append(Frame(frame.id, bytes(frame.data[: frame.length]), now_ns, flags))
        self._face.n_out = 0
