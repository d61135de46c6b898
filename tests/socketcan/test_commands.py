"""The commands on a real interface: patches in one process, the master in another, the doctor beside."""

import signal
import time

import pytest

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.frame import Frame
from tests.cli.patience import PATIENCE_S
from tests.socketcan.many import many_patches
from tests.socketcan.processes import end, master_on, wait_for, wait_for_patches
from tests.socketcan.slcan_adapter import SlcanAdapter


@pytest.fixture
def master(channel):
    with master_on(channel) as sdo:
        yield sdo


def test_sim_and_run_and_doctor_on_one_interface(start, master, channel):
    sim = start("sim", "forearm", "--channel", channel)
    run = start("run", "forearm", "--channel", channel, "--quiet")
    wait_for_patches(master, 24)
    said = end(run)
    assert "stopping" in said
    assert "of 24 patches alive" in said
    said, _ = start("doctor", "forearm", "--channel", channel).communicate(timeout=PATIENCE_S)
    end(sim)

    assert "ok   interface " in said
    assert "ok   permission " in said


def test_126_patches_on_one_interface(start, master, channel, tmp_path):
    arm, scene = many_patches(tmp_path, rate_hz=2.0)  # which a busy machine can do, too
    sim = start("sim", scene, "--channel", channel)
    run = start("run", arm, "--channel", channel, "--quiet")
    wait_for_patches(master, 126)
    begun = master["Cycle"]["Cycles"].raw
    wait_for(lambda: master["Cycle"]["Cycles"].raw >= begun + 6)
    wait_for_patches(master, 126)
    assert master["Frames"]["Accepted"].raw > 504 * 2
    end(run)
    end(sim)


def frames_until(observer, is_last):
    """All frames up to the first that is wanted."""
    frames = []
    give_up_s = time.monotonic() + PATIENCE_S
    while not any(map(is_last, frames)):
        assert time.monotonic() < give_up_s
        frames += observer.receive(1.0)
    return frames


def shows_force(frame):
    return 0x681 <= frame.can_id <= 0x690 and any(frame.data[6:])


def test_a_master_that_is_killed_is_followed_at_once_and_one_that_is_terminated_takes_its_leave(
    start, channel
):
    sim = start("sim", "pad", "--channel", channel)
    leave = Frame(0x000, bytes([128, 0]))  # all nodes to pre-operational
    for ending in (signal.SIGKILL, signal.SIGTERM):
        run = start("run", "pad", "--channel", channel, "--quiet")
        with SocketCanBus(channel) as observer:
            frames_until(observer, shows_force)
            run.send_signal(ending)
            out, _ = run.communicate(timeout=PATIENCE_S)
            if ending == signal.SIGKILL:
                assert run.returncode == -ending, out
            else:
                assert run.returncode == 0 or "silent: " in out, out
            if ending == signal.SIGTERM:
                frames = frames_until(observer, lambda frame: frame[:2] == leave[:2])
    last = {frame.can_id: frame for frame in frames if 0x681 <= frame.can_id <= 0x690}
    assert last
    assert not any(map(shows_force, last.values())), "a contact was left behind"
    end(sim)


def test_of_two_masters_that_are_started_together_one_runs(start, channel):
    sim = start("sim", "pad", "--channel", channel)
    runs = [start("run", "pad", "--channel", channel, "--quiet") for _ in range(2)]
    with SocketCanBus(channel) as observer:
        frames_until(observer, lambda frame: any(run.poll() is not None for run in runs))
        (loser,) = [run for run in runs if run.poll() is not None]
        out, _ = loser.communicate(timeout=PATIENCE_S)
        assert (loser.returncode, "another master" in out or "a master is at work" in out) == (3, True), out
        frames_until(observer, shows_force)
    (winner,) = [run for run in runs if run is not loser]
    winner.send_signal(signal.SIGTERM)
    out, _ = winner.communicate(timeout=PATIENCE_S)
    assert winner.returncode == 0 or "silent: " in out, out
    end(sim)


def test_doctor_tells_of_a_wrong_bit_rate_and_a_short_queue(start, channel):
    with SlcanAdapter(channel) as adapter:  # at 500 kbit/s, with the ten frames that Linux gives
        doctor = start("doctor", "--channel", adapter.channel)
        out, _ = doctor.communicate(timeout=PATIENCE_S)
    assert doctor.returncode == 1
    told = out.splitlines()
    (place,) = [k for k, line in enumerate(told) if line.startswith("fix  bit rate") and "500000" in line]
    assert f"ip link set {adapter.channel} up type can bitrate 1000000" in told[place + 1]
    assert f"-> ip link set {adapter.channel} txqueuelen 128" in out
