"""The examples of the docs run as they stand; what they open is simulated, and their waits are short."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import skinbus
from skinbus.errors import BusError
from skinbus.skin.cycle import PatchState
from skinbus.skin.feed import Feed
from skinbus.skin.shared_memory import SharedWriter, path_of
from skinbus.skin.skin import Skin
from tests.cli.invoke import run as command_line
from tests.cli.patience import PATIENCE_S
from tests.files import put
from tests.skin.scenes import write
from tests.skin.scripted import made_cycle
from tests.skin.shared_processes import CRAFTED, LAYOUT, crafted_memory, uniform

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "docs" / "examples"


@pytest.fixture
def opened(monkeypatch, tmp_path):
    """``skinbus.open`` of an example: a simulated second, with a touch of 5 N."""
    scene = write(tmp_path)
    asked = []

    def stand_in(arm, **settings):
        asked.append((arm, settings))
        return skinbus.simulate(scene)

    monkeypatch.setattr(skinbus, "open", stand_in, raising=False)
    monkeypatch.chdir(tmp_path)
    return asked


def run(name, **changes):
    """Run an example, with some of its constants changed."""
    text = (EXAMPLES / name).read_text()
    assert len(text.splitlines()) <= 20
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    exec(compile(text, name, "exec"), {"__name__": "__main__"})


ENDED = "stop: the skin has ended\n"


@pytest.mark.slow
def test_the_robot_is_stopped_by_too_much_force_and_when_the_skin_ends(opened, capsys):
    run("stop_on_force.py")
    said = capsys.readouterr().out
    assert re.fullmatch(
        r"(stop: patch 1 (BOOTING|OPERATIONAL), inf ms old\n){0,5}" + ENDED, said
    )  # boots first
    run("stop_on_force.py", **{"LIMIT_N, STALE_PERIODS = 15.0": "LIMIT_N, STALE_PERIODS = 3.0"})
    assert re.search(r"stop: \d\.\d N on plate at \d+ mm", capsys.readouterr().out)
    assert opened[0] == ("forearm", {"channel": "can0"})


@pytest.mark.parametrize("state", set(PatchState) - {PatchState.OPERATIONAL})
def test_the_robot_is_stopped_by_any_state_but_operational(played, capsys, state):
    played(0.0, state)
    assert f" {state.name}, 0 ms old\n" in capsys.readouterr().out


def test_the_robot_is_stopped_when_no_more_cycles_come(played, capsys):
    played(0.05, PatchState.OPERATIONAL)
    assert capsys.readouterr().out == ENDED
    played(0.07, PatchState.OPERATIONAL)
    assert re.search(r"stop: patch \d+ OPERATIONAL, 70 ms old\n", capsys.readouterr().out)


def test_the_robot_is_stopped_by_an_error(monkeypatch, capsys):
    def fail(arm, **settings):
        raise BusError("the interface has gone")

    monkeypatch.setattr(skinbus, "open", fail, raising=False)
    with pytest.raises(BusError):
        run("stop_on_force.py")
    assert capsys.readouterr().out == ENDED


@pytest.fixture
def played(monkeypatch):
    """Runs the example on a source whose newest cycle is so old, with its patches in a state."""

    def play(age_s, state):
        feed = OneCycle(round(1e9 * age_s), state)
        monkeypatch.setattr(skinbus, "open", lambda arm, **settings: Skin(feed), raising=False)
        run("stop_on_force.py")

    return play


class OneCycle(Feed):
    """A source of one cycle and no more, that ends after it was asked for it twice."""

    def __init__(self, age_ns, state):
        super().__init__(LAYOUT, "a test")
        self._cycle = made_cycle(1, time.monotonic_ns(), LAYOUT, age_ns=age_ns)
        self._cycle.patch_records["state"] = state
        self._left = 2

    @property
    def is_over(self):
        return self._left == 0

    def peek(self):
        return self._cycle

    def newest(self):
        self._left -= 1
        return self._cycle


@pytest.mark.slow
def test_contacts_are_logged_and_plotted(opened, monkeypatch):
    matplotlib = pytest.importorskip("matplotlib")
    parquet = pytest.importorskip("pyarrow.parquet")
    matplotlib.use("Agg")
    run("log_and_plot.py")
    table = parquet.read_table("contacts.parquet").to_pydict()
    assert set(table["id"]) == {1}
    assert len(table["id"]) > 30
    assert Path("forces.png").stat().st_size > 1000


@pytest.mark.slow
def test_the_example_of_the_readme_runs_as_it_stands(capsys):
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    exec(compile(example, "README.md", "exec"), {"__name__": "__main__"})
    assert re.match(r"1 forearm \[.*\] \d+\.\d N TOUCH\n1 forearm", capsys.readouterr().out)


@pytest.mark.slow
def test_the_tutorial_runs_as_it_stands_up_to_its_bus(tmp_path, monkeypatch, capsys):
    pytest.importorskip("yourdfpy")
    text = (ROOT / "docs" / "tutorial.md").read_text().partition("## Put it on a bus")[0]
    text = text.replace("skinbus view", "skinbus scene check")  # which ends
    (tmp_path / "skinbus").symlink_to(ROOT)
    (folder := tmp_path / "my-skin").mkdir()
    monkeypatch.chdir(folder)
    for kind, title, body in re.findall(r'```(\w+)(?: title="(.*?)")?\n(.*?)```', text, re.DOTALL):
        if title:
            put(folder, title, body)
        if kind == "python":
            exec(compile(body, title, "exec"), {"__name__": "__main__"})
        elif kind == "sh" and "pip install" not in body:  # what is installed is tested elsewhere
            for line in body.splitlines():
                if line.startswith("skinbus "):
                    print(command_line(*shlex.split(line)[1:]))
                else:
                    subprocess.run(line, shell=True, check=True)
    said = capsys.readouterr().out
    assert re.search(r"touched: forearm_link\n\d\.\d N at -?\d+, -?\d+, \d+ mm from the base", said)
    assert "nan" not in said
    assert said.endswith("5.00 N of 5 N\n")


@pytest.fixture
def writer(monkeypatch):
    """Writes cycles to shared memory under another name than "arm", which may be in use on this machine."""
    name = f"example-{os.getpid()}"
    attach = skinbus.attach
    monkeypatch.setattr(skinbus, "attach", lambda arm: attach(name), raising=False)
    writer = SharedWriter(name, LAYOUT)
    writer.name = name
    yield writer
    writer.close()
    path_of(name).unlink(missing_ok=True)


@pytest.fixture
def crafted():
    """Makes memory with a number in its header, or in its first patch, that is none of ours."""
    name = f"crafted-{os.getpid()}"
    yield lambda at, value: crafted_memory(name, at, value)
    path_of(name).unlink(missing_ok=True)


def test_the_control_loop_prints_what_latest_takes(writer, capsys):
    writer.write(uniform(1))
    run("control_loop.py", **{"SECONDS, PERIOD_NS = 10, 1_000_000": "SECONDS, PERIOD_NS = 1, 10_000"})
    said = capsys.readouterr().out
    assert re.match(r"latest\(\): p50 [\d.]+ us, p99 [\d.]+ us, max [\d.]+ us; age now \d+ ms", said)


@pytest.fixture(scope="module")
def read_skin(tmp_path_factory):
    """The C example, compiled."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    program = tmp_path_factory.mktemp("c") / "read_skin"
    source = EXAMPLES / "read_skin.c"
    command = ["cc", "-std=gnu11", "-Wall", "-Werror", "-O2", "-o", program, source, "-lrt"]
    subprocess.run(command, check=True, timeout=PATIENCE_S)
    return lambda name: subprocess.run([program, name], capture_output=True, text=True, timeout=PATIENCE_S)


def test_a_c_program_reads_whole_cycles_while_they_are_written(writer, read_skin):
    assert read_skin(writer.name).stdout == "cycle 0, -1.0 ms old, starting\n"
    stop = threading.Event()

    def keep_writing():
        number = 0
        while not stop.is_set():
            number += 1
            writer.write(uniform(number))

    thread = threading.Thread(target=keep_writing)
    thread.start()
    try:
        for _ in range(20):
            head, *rows = read_skin(writer.name).stdout.splitlines()
            number = int(re.match(r"cycle (\d+), ([\d.]+) ms old, (running|stale)", head)[1])
            assert len(rows) == number % 65
            assert all(float(word) == number for row in rows for word in (row.split()[1], row.split()[3]))
    finally:
        stop.set()
        thread.join()
    writer.close()
    assert read_skin(writer.name).returncode == 1


def test_a_c_program_tells_a_writer_that_runs_from_one_that_hangs_or_was_stopped(writer, read_skin):
    writer.write(
        uniform(1, time.monotonic_ns() + 3_600_000_000_000)
    )  # in the future: not stale, however busy
    said = read_skin(writer.name)
    assert said.stdout.splitlines()[0].endswith("old, running")
    assert said.returncode == 0
    writer.write(uniform(2, time.monotonic_ns() - 3 * LAYOUT.period_ns))
    said = read_skin(writer.name)
    assert said.stdout.splitlines()[0].endswith("old, stale")
    assert said.returncode == 2


@pytest.mark.parametrize(("at", "value"), CRAFTED)
def test_a_crafted_header_ends_a_c_program_soon(crafted, read_skin, at, value):
    said = read_skin(crafted(at, value))
    assert said.returncode in (1, 2)
    assert "running" not in said.stdout


def test_a_c_program_reads_plain_files_of_a_trusted_owner_only(read_skin, crafted):
    name = crafted(16, 0)
    path_of(name).chmod(0o666)
    assert read_skin(name).returncode == 1
    path_of(name).unlink()
    os.mkfifo(path_of(name))
    assert read_skin(name).returncode == 1


@pytest.mark.slow
def test_a_c_program_reports_a_writer_that_was_killed(read_skin):
    name = f"killed-{os.getpid()}"
    command = [sys.executable, "-m", "tests.skin.shared_processes", "write", name, "0.01"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        while read_skin(name).stdout.startswith("cycle 0"):
            pass
        process.kill()
        process.wait()
        said = read_skin(name)
        assert re.match(r"cycle [1-9]\d*, [\d.]+ ms old, died", said.stdout)
        assert said.returncode == 2
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        path_of(name).unlink(missing_ok=True)
