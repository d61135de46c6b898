"""The check of a board: ours passes every rule, and each broken board fails the rule that it breaks."""

import itertools

import pytest

from skinbus.can.virtual_bus import VirtualBus
from skinbus.master.commissioning.patch_check import RULES, Grade, PatchCheck
from skinbus.node import Device
from skinbus.node.context import NS_PER_MS
from skinbus.objects.eds import eds_names, find_eds, load_eds
from tests.files import put
from tests.master.misbehaving import Delayed

NODE = 5
BOARDS = [name for name in eds_names() if name.startswith("skin-patch")]
LIMIT_NS = 200_000 * NS_PER_MS


class Board(Delayed):
    """A device whose frames pass through a fault: it is given each frame and returns it, another, or None.

    A frame may be a time (ns) later than it was made.
    """

    cob_ids = None

    def __init__(self, device, fault):
        super().__init__(device)
        self.fault = fault

    def later(self, now_ns, frame):
        out = self.fault(frame)
        return [(out.t_ns, out)] if out is not None else []


class Sampled(Device):
    """A device whose guard has a sample in every step, and each millisecond."""

    def step(self, now_ns, frames=()):
        self.sampled(0)
        step = super().step(now_ns, frames)
        return step._replace(wake_ns=min(step.wake_ns, now_ns + NS_PER_MS)) if self.guards else step


def device(eds="skin-patch"):
    return Sampled(load_eds(eds, NODE), NODE, storage={})


def check(board, eds="skin-patch", n_syncs=50):
    """Return what came of each rule by its name."""
    wire = VirtualBus(1_000_000, data_bitrate=2_000_000)
    wire.attach(board)
    od = load_eds(eds, NODE)
    core = PatchCheck(NODE, od, 5 * NS_PER_MS, RULES, n_syncs=n_syncs, destructive=True)
    wire.attach(core)
    wire.run(wire.now_ns + LIMIT_NS)
    assert [result.rule for result in core.results] == list(RULES)
    return {result.rule.name: result for result in core.results}


def fails(findings):
    return {name for name, finding in findings.items() if finding.grade is Grade.FAIL}


@pytest.mark.parametrize("eds", BOARDS)
def test_our_own_boards_pass_every_rule(eds):
    findings = check(device(eds), eds)
    assert fails(findings) == set(), findings
    skipped = {name for name, finding in findings.items() if finding.grade is Grade.SKIPPED}
    assert skipped == {"pressed"}


def test_guard_without_samples_is_found():
    never = Device(load_eds("skin-patch", NODE), NODE, storage={})
    assert fails(check(never)) == {"guard"}


def test_stored_parameters_are_kept_unless_their_loss_is_accepted():
    wire = VirtualBus()
    board = device()
    wire.attach(board)
    core = PatchCheck(NODE, load_eds("skin-patch", NODE), 5 * NS_PER_MS, RULES, n_syncs=50)
    wire.attach(core)
    wire.run(LIMIT_NS)
    assert core.passed
    assert [r.rule.name for r in core.results if r.grade is Grade.SKIPPED] == [
        "pressed",
        "storage",
        "areas of storage",
    ]
    # and what the rules have changed is gone: the board was reset last
    assert board.get(0x1017) == 500
    assert board.get(0x1020, 1) == 0


def test_another_board_is_not_the_one_of_the_eds():
    findings = check(device("skin-patch-8bit"), "skin-patch")
    assert {"identity", "PDO parameters", "readings"} <= fails(findings)
    assert "0x1018:02" in findings["identity"].detail


def test_readings_off_their_zero_or_not_adjusted_are_found(tmp_path):
    head, mark, rest = find_eds("skin-patch").read_text().partition("ParameterName=Bits\n")
    own = put(tmp_path, "own.eds", head + mark + rest.replace("DefaultValue=16", "DefaultValue=12", 1))
    board = device(own)
    board.step(0)
    board.image_view(0x6401, 1, 16)[:] = 0
    board.image_view(0x6401, 1, 16)[3] = 0x3001
    findings = check(board, own)
    assert fails(findings) == {"left-adjusted", "at rest"}
    assert findings["left-adjusted"].detail.startswith("reading 4 is")


def test_nobody_there_fails_and_ends():
    findings = check(Board(device(), lambda frame: None))
    assert fails(findings) >= {"boot-up", "identity", "heartbeat", "readings", "EMCY", "LSS", "storage"}


# what else firmware does wrong is in tests/firmware/mutants.txt
@pytest.mark.slow
@pytest.mark.parametrize(
    ("is_late", "ms"), [(lambda k: k % 400 == 4, 2), (lambda k: k == 3603, 8)], ids=["out of order", "once"]
)
def test_tpdos_that_are_late_at_times_are_named(is_late, ms):
    number = itertools.count()

    def late(frame):
        later_ms = ms if frame.can_id in (0x185, 0x285, 0x385, 0x485) and is_late(next(number)) else 0
        return frame._replace(t_ns=frame.t_ns + later_ms * NS_PER_MS)

    assert "readings" in fails(check(Board(device(), late), n_syncs=2000))
