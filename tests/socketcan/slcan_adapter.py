"""A CAN adapter played by the test: a pty with the kernel's slcan on one side and a vcan on the other.

It is a real can-dev interface with states and error counters, and the test decides what the bus does to it.
"""

import array
import fcntl
import os
import select
import termios
import threading
import tty

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.frame import Frame
from tests.socketcan.can_rig import ip

N_SLCAN = 17
SIOCGIFNAME = 0x8910


class SlcanAdapter:
    """``channel`` is the new interface; frames go to and come from a bus; used with ``with``."""

    def __init__(self, bus_channel):
        self._bus = SocketCanBus(bus_channel)
        self._main, self._line = os.openpty()
        tty.setraw(self._line)
        fcntl.ioctl(self._line, termios.TIOCSETD, array.array("i", [N_SLCAN]))
        answer = fcntl.ioctl(self._line, SIOCGIFNAME, bytes(32))
        self.channel = answer.split(b"\0")[0].decode()
        self.listening = True
        """Whether the adapter takes what the kernel sends; when not, its queue fills."""
        self.connected = True
        """Whether frames go to and come from the bus."""
        self._ended = False
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._work, daemon=True)

    def __enter__(self):
        self._thread.start()
        ip("link", "set", self.channel, "type", "can", "bitrate", "500000")
        ip("link", "set", self.channel, "up")
        return self

    def __exit__(self, *exc):
        self.listening = True
        ip("link", "set", self.channel, "down")
        self._ended = True
        self._thread.join()
        os.close(self._line)
        os.close(self._main)
        self._bus.close()

    def say(self, text):
        """Tell the kernel something: sp000128 is error-passive, sb000255 bus-off, sa000000 error-active."""
        with self._lock:
            os.write(self._main, text.encode() + b"\r")

    def _work(self):
        rest = b""
        while not self._ended:
            ready, _, _ = select.select(
                [self._main, self._bus.descriptors()[0]] if self.listening else [], (), (), 0.01
            )
            if self._main in ready:
                *lines, rest = (rest + os.read(self._main, 4096)).split(b"\r")
                frames = [_frame(line) for line in lines if line[:1] == b"t"]
                if self.connected:
                    self._bus.send(frames)
            if self._bus.descriptors()[0] in ready:
                frames = self._bus.receive()
                text = b"".join(_text(frame) for frame in frames if self.connected and not frame.flags)
                with self._lock:
                    while text and not self._ended:
                        text = text[os.write(self._main, text[:1024]) :]


def _frame(line):
    return Frame(int(line[1:4], 16), bytes.fromhex(line[5 : 5 + 2 * int(line[4:5])].decode()))


def _text(frame):
    return b"t%03X%d%s\r" % (frame.can_id, len(frame.data), frame.data.hex().upper().encode())
