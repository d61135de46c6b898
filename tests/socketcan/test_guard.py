"""The guard beside patches and a master on a real interface: what stops the robot, and its own end."""

import signal

import pytest

from skinbus.config.arm_file import find_arm
from tests.cli.patience import PATIENCE_S, until_in_time
from tests.files import put
from tests.socketcan.can_rig import EDS
from tests.socketcan.skin_rig import PRESS

GUARD = """
[guard]
liveness_ms = 1000
[[guard.region]]
name = "pad"
force_n = 2.0
source = "a test"
"""


REASONS = {
    "press": "GFC",
    "master is killed": "master silent",
    "guard is terminated": "the guard was asked to end",
}


@pytest.mark.parametrize("fault", REASONS)
def test_a_press_a_dead_master_and_its_own_end_run_the_command(start, make_channel, tmp_path, fault):
    arm, scene = tmp_path / "pad.toml", tmp_path / "scene.toml"
    # at rates that a busy machine can follow
    board, text = (EDS / "skin-patch.eds").read_text(), find_arm("pad").read_text()
    before, section, after = board.partition("[2080sub4]")
    slow = after.replace("DefaultValue=1000\n", "DefaultValue=300000\n", 1)
    put(tmp_path, "slow.eds", before + section + slow)
    arm.write_text(text.replace("100.0", "10.0").replace('"skin-patch"', '"slow.eds"') + GUARD)
    begin_s = 10.0 if fault == "press" else 90_000.0
    text = PRESS.format(arm=arm, link="plate").replace("start_s = 0.0", f"start_s = {begin_s}")
    scene.write_text(text.replace("force_n = 5.0", "force_n = 10.0"))
    reason = f"guard-stop, {REASONS[fault]}"

    def attempt():
        """What the guard says until the command has run."""
        channel, done = make_channel(), tmp_path / "done"
        done.unlink(missing_ok=True)
        sim = start("sim", str(scene), "--channel", channel)
        guard = start("guard", str(arm), "--channel", channel, "--stop", f"command:touch {done}")
        run = start("run", str(arm), "--channel", channel, "--quiet")
        said, to_end = "", [guard, run, sim]
        for line in guard.stdout:
            said += line
            if line.strip().endswith(" guarding"):
                assert not done.exists()
                if fault == "master is killed":
                    run.kill()
                if fault == "guard is terminated":
                    to_end.remove(guard)  # a second signal would interrupt its end
                    guard.send_signal(signal.SIGTERM)
            if line.startswith("done: "):
                break
        assert done.exists(), said
        for process in to_end:
            process.send_signal(signal.SIGINT)
        said += guard.communicate(timeout=PATIENCE_S)[0]
        assert guard.returncode == (reason not in said or fault != "guard is terminated"), said
        for process in (run, sim):
            process.communicate(timeout=PATIENCE_S)
        return said

    # a machine that holds a process up for more than a second stops the robot, too
    said = until_in_time(attempt, lambda said: reason in said)
    assert reason in said
    assert said.startswith("This guard is not certified")
