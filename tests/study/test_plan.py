"""Plans: what holds, what does not, and that the road on the wire keeps the promise."""

import json

import pytest
from click.testing import CliRunner

from skinbus.bus.wire import Wire
from skinbus.cli import group
from skinbus.master import Master
from skinbus.objects.arm import load_arm, ods_of
from skinbus.sim import World, load_scene
from skinbus.study.plan import plan, plans
from skinbus.study.schedule import CycleDelays, Release, cycle_times
from skinbus.study.traffic import traffic

COMPUTES = {"kmeans": 400_000, "fit": 500_000}


def test_shipped_arms_hold_at_their_own_rate():
    for name in ("pad", "forearm", "arm"):
        result = plan(load_arm(name), COMPUTES, level="fit", response_ns=100_000)
        assert result.holds, (name, result.warnings)
        assert not result.warnings


def test_largest_rate_holds_and_the_next_does_not():
    arm = load_arm("forearm")
    largest = plan(arm, COMPUTES, level="kmeans").levels[0].largest_hz
    assert plan(arm, COMPUTES, level="kmeans", rate_hz=largest).holds
    assert not plan(arm, COMPUTES, level="kmeans", rate_hz=largest + 0.5).holds


def test_overfull_plan_says_what_would_help():
    result = plan(load_arm("forearm"), COMPUTES, level="kmeans", rate_hz=90)
    assert not result.holds
    text = "\n".join(result.warnings)
    assert "of the bus" in text
    assert "Hz instead of 90 Hz" in text
    assert "8-bit" in text
    assert "second bus" in text


def test_slow_level_is_to_blame_when_only_computing_is_too_long():
    result = plan(load_arm("pad"), {"kmeans": 400_000, "full": 20_000_000}, level="full")
    assert not result.holds
    assert any("computing takes 20.00 ms" in warning for warning in result.warnings)
    assert any("level kmeans instead of full" in warning for warning in result.warnings)


@pytest.mark.parametrize("name", ["pad", "forearm"])
def test_road_on_the_wire_keeps_every_bound_of_its_cycle(name):
    scene = load_scene(name)
    bounds = cycle_times(
        traffic(ods_of(scene.arm), rate_hz=scene.arm.bus.rate_hz).messages, 1_000_000, CycleDelays()
    )
    master, world = Master(scene.arm), World(scene)
    wire = Wire(1_000_000)
    wire.attach(world)
    wire.attach(master)
    wire.run(1_000_000_000)  # booting is no cyclic traffic
    begin = wire.now_ns
    worst, synced = {}, [None]
    messages = traffic(ods_of(scene.arm), rate_hz=scene.arm.bus.rate_hz).messages
    cyclic = {m.cob_id for m in messages if m.release in (Release.READING, Release.PUBLISHED)}

    def note(frame):
        if frame.can_id == 0x80:
            synced[0] = frame.t_ns
        elif frame.can_id in cyclic and synced[0] is not None:
            worst[frame.can_id] = max(worst.get(frame.can_id, 0), frame.t_ns - synced[0])

    wire.tap(note)
    wire.run(begin + 2_500_000_000)
    assert len(worst) >= 4 * scene.arm.n_patches + 2
    assert all(t <= bounds[cob_id] for cob_id, t in worst.items())


def test_command_answers_with_its_exit_status_and_writes_json(tmp_path):
    file = tmp_path / "plan.json"
    good = CliRunner().invoke(group, ["plan", "forearm", "--compute-us", "500", "--json", str(file)])
    assert good.exit_code == 0, good.output
    written = json.loads(file.read_text())
    assert written["holds"]
    assert len(written["messages"]) > 24 * 4 + 17
    assert all(m["worst_us"] is not None for m in written["messages"])
    bad = CliRunner().invoke(group, ["plan", "forearm", "--compute-us", "500", "--bitrate", "500000"])
    assert bad.exit_code == 1, bad.output
    assert "1 Mbit/s" in bad.output


def test_each_bus_has_its_plan_and_contacts_wait_for_the_readings_of_all():
    arm = load_arm("arm-two-buses")
    computes = {"fit": 1_000_000}
    upper, lower = plans(arm, computes, level="fit")
    alone = plan(arm.part(1), computes, level="fit")
    assert upper.holds
    assert lower.holds
    assert (upper.n_patches, lower.n_patches) == (27, 21)
    assert lower.readings_ns == alone.readings_ns < upper.readings_ns
    assert lower.published_ns - alone.published_ns >= upper.readings_ns - lower.readings_ns
    assert upper.published_ns == plan(arm.part(0), computes, level="fit").published_ns
    assert lower.arm == "arm on two buses, bus lower"
    assert [p.arm for p in plans(load_arm("pad"), computes, level="fit")] == ["pad"]
