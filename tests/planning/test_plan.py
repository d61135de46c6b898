"""Plans: what holds, what does not, and that the simulated wire keeps the promise."""

import pytest

from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import load_arm, ods_of
from skinbus.master import Master
from skinbus.model import grid
from skinbus.objects.new_board import NewBoard
from skinbus.planning.plan import plans
from skinbus.planning.schedule import Release, cycle_times
from skinbus.planning.traffic import traffic
from skinbus.sim import World, load_scene
from tests.cli.invoke import run
from tests.files import put

pytestmark = pytest.mark.slow

COMPUTES = {"kmeans": 400_000, "fit": 500_000}


def plan(*args, **settings):
    """The plan of an arm with one bus."""
    (one,) = plans(*args, **settings)
    return one


def test_shipped_arms_hold_at_their_own_rate():
    for name in ("pad", "forearm", "arm"):
        result = plan(load_arm(name), COMPUTES, level="fit", response_ns=100_000)
        assert result.holds, (name, result.warnings)
        assert not result.warnings


def test_slow_level_is_to_blame_when_only_computing_is_too_long():
    result = plan(load_arm("pad"), {"kmeans": 400_000, "full": 20_000_000}, level="full")
    assert not result.holds
    assert any("computing takes 20.00 ms" in warning for warning in result.warnings)
    assert any("level kmeans instead of full" in warning for warning in result.warnings)


@pytest.mark.parametrize("name", ["pad", "forearm"])
def test_simulated_wire_keeps_every_bound_of_its_cycle(name):
    scene = load_scene(name)
    bounds = cycle_times(traffic(ods_of(scene.arm), rate_hz=scene.arm.bus.rate_hz).messages, 1_000_000)
    master, world = Master(scene.arm), World(scene)
    wire = VirtualBus(1_000_000)
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


def test_command_answers_with_its_exit_status():
    run("plan", "forearm", "--compute-us", "500")
    bad = run("plan", "forearm", "--compute-us", "500", "--bitrate", "500000", status=1)
    assert "1 Mbit/s" in bad


def test_each_bus_has_its_plan_and_contacts_wait_for_the_readings_of_all():
    arm = load_arm("arm-two-buses")
    computes = {"fit": 1_000_000}
    upper, lower = plans(arm, computes, level="fit")
    alone = plan(arm.part(1), computes, level="fit")
    assert upper.holds
    assert lower.holds
    assert (len(upper.ods), len(lower.ods)) == (27, 21)
    assert lower.readings_ns == alone.readings_ns < upper.readings_ns
    assert lower.published_ns - alone.published_ns >= upper.readings_ns - lower.readings_ns
    assert upper.published_ns == plan(arm.part(0), computes, level="fit").published_ns
    assert lower.arm == "arm on two buses, bus lower"
    assert [p.arm for p in plans(load_arm("pad"), computes, level="fit")] == ["pad"]


CANFD = """
[arm]
name = "fd"
rate_hz = {rate_hz}
{canfd}
[[link]]
name = "forearm"
surface = "cylinder"
length_mm = 160.0
radius_mm = 64.94
"""
RING = '[[ring]]\nlink = "forearm"\ns_mm = {s}\ncount = 8\nfirst_node_id = {first}\neds = "{eds}"\n'


def forearm_with(folder, eds, rate_hz, canfd=""):
    text = CANFD.format(rate_hz=rate_hz, canfd=canfd)
    text += "".join(RING.format(s=28 + 51 * k, first=1 + 8 * k, eds=eds) for k in range(3))
    return put(folder, "fd.toml", text)


def test_plan_counts_can_fd_frames_in_both_phases(tmp_path):
    arm = load_arm(forearm_with(tmp_path, "skin-patch-fd", 130.0, "canfd = true\ndata_bitrate = 5_000_000"))
    result = plan(arm, COMPUTES, level="fit")
    assert result.holds, result.warnings
    readings = [row.message for row in result.rows if row.message.release is Release.READING]
    assert {(m.bits, m.data_bits) for m in readings} == {(34, 518)}
    assert len(readings) == 24
    cycle_ns = 24 * 137_600 + (65 + 17 * 135) * 1000
    assert result.cyclic_load == pytest.approx(130.0 * cycle_ns * 1e-9)
    slow = plan(arm, COMPUTES, level="fit", rate_hz=40)
    assert (slow.readings_ns, slow.published_ns) < (result.readings_ns + 1, result.published_ns + 1)


@pytest.fixture(scope="module")
def too_fast(tmp_path_factory):
    """The plan of boards at 90 Hz that hold at 52 Hz."""
    path = forearm_with(tmp_path_factory.mktemp("fast"), "skin-patch", 90.0)
    return plan(load_arm(path, check_load=False), COMPUTES, level="kmeans")


def test_plan_names_can_fd_as_a_remedy(tmp_path, too_fast):
    assert not too_fast.holds
    (remedy,) = [warning for warning in too_fast.warnings if "CAN FD" in warning]
    largest = float(remedy.rsplit(" ", 2)[1])
    fd = load_arm(forearm_with(tmp_path, "skin-patch-fd", largest, "canfd = true"), check_load=False)
    assert plan(fd, COMPUTES, level="kmeans").holds
    assert not plan(fd, COMPUTES, level="kmeans", rate_hz=largest + 0.5).holds


def test_plan_says_when_canfd_changes_nothing(tmp_path):
    said = "canfd = true changes nothing"
    classic = load_arm(forearm_with(tmp_path, "skin-patch", 30.0, "canfd = true"))
    result = plan(classic, COMPUTES, level="kmeans")
    assert result.holds
    assert [warning.partition(":")[0] for warning in result.warnings] == [said]
    for eds, canfd in (("skin-patch", ""), ("skin-patch-fd", "canfd = true")):
        arm = load_arm(forearm_with(tmp_path, eds, 30.0, canfd))
        assert not plan(arm, COMPUTES, level="kmeans").warnings


@pytest.mark.parametrize(
    ("eds", "rate_hz", "bitrate", "least"),
    [
        ("skin-patch", 50.0, 500_000, "1 Mbit/s"),
        ("skin-patch-8bit", 120.0, 1_000_000, "second bus"),
    ],
)
def test_least_change_that_is_enough_is_named(tmp_path, eds, rate_hz, bitrate, least):
    arm = load_arm(forearm_with(tmp_path, eds, rate_hz), check_load=False)
    result = plan(arm, COMPUTES, level="kmeans", bitrate=bitrate)
    (remedy,) = [warning for warning in result.warnings if "that is enough" in warning]
    assert least in remedy


def test_boards_of_ones_own_have_the_same_remedies_as_shipped_ones(tmp_path, too_fast):
    own = NewBoard(name="own.eds", tactels_uv=grid(4, 4, 10e-3), pitch=10e-3, bits=12)
    put(tmp_path, "own.eds", own.text())
    arm = load_arm(forearm_with(tmp_path, "own.eds", 90.0), check_load=False)
    assert plan(arm, COMPUTES, level="kmeans").warnings == too_fast.warnings
    (least,) = [warning for warning in too_fast.warnings if "that is enough" in warning]
    assert "8-bit" in least
