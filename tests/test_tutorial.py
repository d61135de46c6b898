"""The tutorial is run from top to bottom: files as they are shown, commands, programs."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from skinbus import attach
from skinbus.errors import ShareError
from tests.cli.patience import PATIENCE_S
from tests.own_bus import own_group

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"```(\w+)(?: title=\"(.*?)\")?\n(.*?)```", re.DOTALL)


class Reader:
    """Somebody who does what the page says, in an empty folder."""

    def __init__(self, folder, channel, name):
        self.folder = folder
        self.names = {}
        self.processes = []
        self._mine = {
            "239.74.163.77": channel,
            'attach("my-arm"': f'attach("{name}"',
            "--share my-arm": f"--share {name}",
        }
        self._mine["./read_skin my-arm"] = f"./read_skin {name}"
        self._shared = name

    def toml(self, text, title):
        (self.folder / title).write_text(text)

    def python(self, text, title):
        exec(compile(self.own(text), "tutorial.md", "exec"), self.names)

    def sh(self, text, title):
        for line in self.own(text).splitlines():
            words = line.removesuffix("&").split()
            if words[0] == "skinbus":
                words = [sys.executable, "-m", *words]
            if line.endswith("&"):
                self.processes.append(subprocess.Popen(words, cwd=self.folder, stdout=subprocess.DEVNULL))
            elif words[0] != "cc" or shutil.which("cc"):
                if words[0] == "./read_skin" and not (self.folder / "read_skin").exists():
                    continue
                done = subprocess.run(
                    words, cwd=self.folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False
                )
                may_be_stale = words[0] == "./read_skin"  # on a busy machine
                assert done.returncode in ((0, 2) if may_be_stale else (0,)), (
                    f"{line}: {done.stdout}{done.stderr}"
                )
        if self.processes and "--share" in text:
            self._wait_for_master()

    def own(self, text):
        """The text with a bus and shared memory that no other test uses."""
        for old, new in self._mine.items():
            text = text.replace(old, new)
        return text

    def _wait_for_master(self):
        """As people do, who start it in another terminal and see it run."""
        while True:
            assert all(process.poll() is None for process in self.processes)
            try:
                attach(self._shared).close()
            except ShareError:
                signal.sigtimedwait([], 0.05)
            else:
                return

    def end(self):
        codes = []
        for process in reversed(self.processes):
            process.send_signal(signal.SIGINT)
            codes.append(process.wait(PATIENCE_S))
        assert codes in ([0, 0], [1, 0])  # 1: on a busy machine a board may have been late at the end


@pytest.fixture
def reader(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(DOCS / "examples" / "read_skin.c", tmp_path)
    reader = Reader(tmp_path, own_group(), f"tutorial-{os.getpid()}")
    yield reader
    for process in reader.processes:
        process.kill()
        process.wait()


@pytest.mark.slow  # a calibration and three processes; the smaller examples run in tests/test_examples.py
def test_it_does_what_it_says(reader, capfd):
    for language, title, text in BLOCK.findall((DOCS / "tutorial.md").read_text()):
        getattr(reader, language)(text, title)
    reader.end()
    said = capfd.readouterr().out
    assert "touched: forearm at 28 mm" in said
    assert "touched: pad at 30 mm" in said
    assert 4.5 < float(re.search(r"([\d.]+) N of 5.0 N", said)[1]) < 5.5
    assert re.search(r"(forearm|pad) \[.*\] [\d.]+ N, \d+ ms old", said)
