"""`skinbus guard` beside a patch and a master that are played by a core."""

import os
from contextlib import closing

import numpy as np
import pytest

from skinbus.can.core import Core, Step
from skinbus.can.frame import Frame
from skinbus.cli.commands.guard import SharedContacts
from skinbus.config.arm_file import find_arm
from skinbus.config.system import load_arm
from skinbus.guard.watch import Guard, Phase, RegionPeaks
from skinbus.skin.contact import CONTACT
from skinbus.skin.cycle import PATCH, Readings, SkinLayout
from skinbus.skin.shared_memory import SharedWriter
from tests.cli.invoke import refused
from tests.files import put
from tests.guard.rig import ARMED, GFC, MS, QUICK_STOP
from tests.run_in_process import run_code
from tests.skin.scripted import made_cycle

pytestmark = pytest.mark.slow

GUARD = """
[guard]
liveness_ms = 1000
[[guard.region]]
name = "pad"
force_n = 5.0
source = "a test"
"""
CALLED = []


class Skin(Core):
    """An armed patch, its master, and a drive that confirms; GFC comes with the n-th frame of liveness."""

    cob_ids = frozenset({QUICK_STOP[0]})

    def __init__(self, gfc_at=None):
        self.n, self.gfc_at, self.due_ns, self.told = 0, gfc_at, 0, []

    def step(self, now_ns, frames):
        self.told += [frame[:2] for frame in frames]
        out = [Frame(0x5E4, bytes.fromhex("6040600000000000")) for _ in frames]
        if now_ns >= self.due_ns:
            self.n, self.due_ns = self.n + 1, now_ns + 20 * MS
            out += [Frame(0x501, bytes([ARMED, 0])), Frame(0x77F, b"\x05")]
            out += [Frame(GFC)] * (self.n == self.gfc_at)
        return Step(out, [], self.due_ns)


def stop():
    """Stop a robot."""
    CALLED.append("stop")


def fail():
    """Do not."""
    raise RuntimeError("no robot")


@pytest.fixture
def arm(tmp_path):
    """The pad with a guard."""
    path = put(tmp_path, "guarded-pad.toml", find_arm("pad").read_text() + GUARD)
    CALLED.clear()
    return path


HERE = "python:tests.cli.commands.test_guard:"


def test_every_stop_is_done_and_none_waits_for_another(own_bus, arm, tmp_path):
    skin, done = Skin(gfc_at=50), tmp_path / "done"
    stops = ["command:false", "cia402:100", f"{HERE}fail", f"{HERE}stop", f"command:touch '{done}'"]
    with own_bus.with_cores(skin):
        words = [word for stop in stops for word in ("--stop", stop)]
        said = own_bus.run("guard", arm, *words, "--seconds", 4, status=1)
    lines = said.splitlines()
    assert lines[0].startswith("This guard is not certified")
    assert "1 of 1 patch guarded" in lines[1]
    for wanted in ("guarding", "guard-stop, GFC", "confirmed: node 100, cia402:100", f"done: {HERE}stop"):
        assert any(wanted in line for line in lines), wanted
    assert [line.partition(": ")[0] for line in lines if "FAILED" in line] == ["STOP FAILED"] * 2
    assert CALLED == ["stop"]
    assert done.exists()
    assert skin.told[0] == QUICK_STOP


def test_its_end_is_a_stop_if_it_guards(own_bus, arm):
    words = ("guard", arm, "--stop", f"{HERE}stop", "--stop", "cia402:100", "--seconds", 2)
    assert "guard-waits, patch 1 silent; master silent" in own_bus.run(*words)
    assert not CALLED
    skin = Skin()
    with own_bus.with_cores(skin):
        assert "guard-stop, the guard was asked to end" in own_bus.run(*words)
    assert CALLED == ["stop"]
    assert skin.told[0] == QUICK_STOP


def test_a_fault_of_the_guard_itself_is_a_stop(own_bus, arm, monkeypatch):
    def step(self, now_ns, frames, whole=Guard.step):
        if self.phase is Phase.GUARDING:
            raise ZeroDivisionError
        return whole(self, now_ns, frames)

    monkeypatch.setattr(Guard, "step", step)
    skin = Skin()
    with own_bus.with_cores(skin), pytest.raises(AssertionError):
        own_bus.run("guard", arm, "--stop", f"{HERE}stop", "--stop", "cia402:100", status=None)
    assert CALLED == ["stop"]
    assert QUICK_STOP in skin.told


def test_what_cannot_stop_or_is_not_guarded_is_refused_before_the_bus(arm):
    said = {
        "command:no-such-program": "there is no program 'no-such-program'",
        "command:halt 'now": "No closing quotation",
        "python:no_such_module:f": "No module named 'no_such_module'",
        f"{HERE}nothing": "no attribute 'nothing'",
        "cia402:1": "wanted a node-ID, 1 to 127, of no patch or master",
    }
    for word, why in said.items():
        assert why in refused("guard", arm, "--stop", word)
    assert "has no [guard]" in refused("guard", "pad", "--stop", "cia402:100")
    assert "Missing option '--stop'" in refused("guard", arm)


def test_what_a_master_shares_is_read_by_region(arm):
    loaded, name = load_arm(arm), f"guard-{os.getpid()}"
    layout, records, pressures = SkinLayout.of(loaded), np.zeros(2, CONTACT), np.arange(16.0)
    records["force"] = 3.0, 7.0
    readings = Readings(pressures, pressures > 0.0, pressures)
    cycle = made_cycle(1, 5, layout, records=records, patch_records=np.zeros(1, PATCH), readings=readings)
    with closing(SharedWriter(name, layout)) as writer:
        writer.write(cycle)
        assert SharedContacts(name, loaded, loaded.guard).read() == RegionPeaks(5, [7.0], [15.0])


def test_it_runs_without_numba_and_estimator(arm):
    code = (
        "import sys; from click.testing import CliRunner; from skinbus.cli import group;"
        "words = ['--interface', 'virtual', '--stop', 'cia402:100', '--seconds', '0.3', '--contacts', 'x'];"
        f"print(CliRunner().invoke(group, ['guard', {str(arm)!r}, *words]).output);"
        "heavy = ('numba', 'llvmlite', 'scipy', 'skinbus.jit', 'skinbus.estimate', 'skinbus.master');"
        "print([m for m in heavy if m in sys.modules])"
    )
    out = run_code(code)
    assert "does `skinbus run --share x` run?" in out
    assert "guard-waits, contacts silent" in out
    assert out.splitlines()[-1] == "[]"
