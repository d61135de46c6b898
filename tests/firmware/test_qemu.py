"""The C on an emulated Cortex-M4, whose time means nothing: over slcan it keeps all rules of the protocol."""

import shutil
import subprocess
import threading
from functools import partial
from importlib.util import find_spec

import pytest

from skinbus.bus.loop import Loop
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.firmware import write_project
from skinbus.master.commissioning.patch_check import RULES, SYNC_PERIOD_NS, Grade, PatchCheck
from skinbus.objects.eds import load_eds
from tests.cli.patience import TRIES
from tests.firmware.test_sizes import compiler, lacks

NODE = 1
LEFT_OUT = "pressed", "heartbeat under load"
"""Nobody presses; and on a busy machine heartbeats come late."""


@pytest.fixture
def channel(tmp_path):
    """A pseudo-terminal with a board at its other end."""
    if not shutil.which("qemu-system-arm") or not find_spec("serial"):
        lacks("qemu-system-arm, and: pip install pyserial")
    write_project("skin-patch", tmp_path)
    cc = " ".join([*compiler("cortex-m4"), "-Wno-unused-command-line-argument"])
    subprocess.run(["make", "-s", "-C", tmp_path, "qemu", f"ARM_CC={cc}", "ARM_CPU="], check=True)
    machine = ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none"]
    command = [*machine, "-serial", "pty", "-kernel", tmp_path / "board-qemu.elf"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        yield next(word for word in running.stdout.readline().split() if word.startswith("/dev/"))
        running.kill()


def broken(channel, rules):
    """Return what came of those rules that the board breaks."""
    core = PatchCheck(NODE, load_eds("skin-patch", NODE), SYNC_PERIOD_NS, rules, n_syncs=50, destructive=True)
    opens = partial(PythonCanBus, "slcan", channel, options={"sleep_after_open": 0})
    Loop(core, [opens], stop=threading.Event()).run()
    assert len(core.results) == len(rules)
    return [result for result in core.results if result.grade is not Grade.PASS]


@pytest.mark.slow
def test_emulated_board_keeps_every_rule_of_the_protocol(channel):
    rules = [rule for rule in RULES if rule.name not in LEFT_OUT]
    for _ in range(TRIES):  # a late answer is none: once more, with the readings that some rules look at
        found = broken(channel, rules)
        if not found:
            break
        rules = [rule for rule in rules if not rule.steps or rule in [result.rule for result in found]]
    assert not found
