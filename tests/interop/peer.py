"""A device of the JavaScript package ``canopen`` as a core: stepped with time and frames like our own.

It runs in a process of its own and has no clock but ours (see npm/peer.js), so hours of its time-outs
pass in no time, and every run is the same.
"""

import json
import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame
from skinbus.objects.eds import find_eds
from tests.files import put
from tests.master import commission

NPM = Path(__file__).parent / "npm"
NEEDED = "install Node.js 18 or newer with npm (apt-get install nodejs npm)"
TRIES = 3
"""To get the package from its registry."""
STEP_NS = 1_000_000


class PeerError(Exception):
    """The peer refused or failed; ``code`` is its SDO abort code, if it has one."""

    def __init__(self, text, code):
        super().__init__(text)
        self.code = code


@dataclass
class Call:
    """Something asked of the peer, and what came of it."""

    number: int
    done: bool = False
    value: Any = None
    error: PeerError | None = None


class JsPeer(Core):
    """The peer as a core; ``call`` asks it for something, ``events`` is what it noticed."""

    cob_ids = None

    def __init__(self):
        self._process = subprocess.Popen(
            ["node", NPM / "peer.js"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=NPM
        )
        self._calls = {}
        self._waiting = []
        self.events = []

    def call(self, name, **arguments):
        """Ask for something; it begins with the peer's next step."""
        call = Call(len(self._calls))
        self._calls[call.number] = call
        self._waiting.append((call.number, name, arguments))
        return call

    def step(self, now_ns, frames):
        """Hand time, frames and wishes over; wait for what it makes of them."""
        calls, self._waiting = self._waiting, []
        request = {
            "t": now_ns,
            "frames": [(f.can_id, f.data.hex()) for f in frames if not f.flags],
            "calls": calls,
        }
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, "the JavaScript peer has ended"
        answer = json.loads(line)
        for kind, detail in answer["events"]:
            if kind in ("done", "failed"):
                call = self._calls[detail["number"]]
                call.done = True
                call.value = detail.get("value")
                call.error = PeerError(detail["text"], detail["code"]) if kind == "failed" else None
            else:
                self.events.append((kind, detail))
        wake_ns = NEVER if answer["wake"] is None else answer["wake"]
        return Step([Frame(can_id, bytes.fromhex(data)) for can_id, data in answer["frames"]], (), wake_ns)

    def told(self, kind):
        """What it said of one kind, in order."""
        return [detail for name, detail in self.events if name == kind]

    def close(self):
        """End its process."""
        self._process.stdin.close()
        self._process.stdout.close()
        try:
            self._process.wait(60)
        except subprocess.TimeoutExpired:  # it has been heard out: how it ends is of no interest
            self._process.kill()
            self._process.wait()


class Bench(commission.Bench):
    """The peer and our cores on one wire."""

    def __init__(self, peer):
        super().__init__(peer)
        self.peer, self.port = peer, self.ports[0]
        self.attach = self.wire.attach

    def ask(self, name, *, within_ms=10_000, **arguments):
        """Have the peer do something and wait, on the clock of the wire, for its end or PeerError."""
        call = self.peer.call(name, **arguments)
        self.wire.wake(self.port)
        for _ in range(within_ms):
            self.wire.run(self.wire.now_ns + STEP_NS)
            if call.done:
                break
        assert call.done, f"{name} {arguments} did not end within {within_ms} ms"
        if call.error is not None:
            raise call.error
        return call.value


def resolved_eds(name, node_id, folder):
    """A copy of one of our EDS files for readers that do not know ``$NODEID``."""
    text = find_eds(name).read_text()
    text = re.sub(r"\$NODEID\+(0x[0-9A-Fa-f]+)", lambda match: f"0x{int(match[1], 16) + node_id:08X}", text)
    assert "$NODEID" not in text
    return put(folder, f"{name}-{node_id}.eds", text)


def require_npm_canopen():
    """Install the peer if it is not there; without Node.js skip the test, but not in CI."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        if os.environ.get("CI"):
            pytest.fail(NEEDED)
        pytest.skip(NEEDED)
    lock = NPM / "package-lock.json"
    stamp = NPM / "node_modules" / ".package-lock.json"
    if stamp.exists() and stamp.stat().st_mtime >= lock.stat().st_mtime:
        return
    for _ in range(TRIES):
        install = subprocess.run(
            ["npm", "ci", "--no-audit", "--no-fund"], cwd=NPM, capture_output=True, text=True, check=False
        )
        if not install.returncode:
            break
    else:
        reason = f"npm ci in {NPM} failed: {install.stderr.strip()[-500:]}"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    stamp.touch()
