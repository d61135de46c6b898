"""The check of a board: ours passes every rule, and each broken board fails the rule that it breaks."""

import numpy as np
import pytest

from skinbus.can.core import Core, Step
from skinbus.can.virtual_bus import VirtualBus
from skinbus.master.commissioning.patch_check import MS, RULES, CheckedPatch, Grade, PatchCheck
from skinbus.node import Device
from skinbus.node.storage import MemoryStorage
from skinbus.objects.eds import eds_names, find_eds, load_eds

NODE = 5
BOARDS = [name for name in eds_names() if name.startswith("skin-patch")]
LIMIT_NS = 60_000 * MS


class Board(Core):
    """A device whose frames pass through a fault: it is given each frame and returns it, another, or None.

    A frame may be a time (ns) later than it was made.
    """

    cob_ids = None

    def __init__(self, device, fault=None, deaf=lambda frame: False):
        self.device = device
        self.fault = fault or (lambda frame: frame)
        self.deaf = deaf
        self.held = []

    def step(self, now_ns, frames):
        step = self.device.step(now_ns, [frame for frame in frames if not self.deaf(frame)])
        self.held += [out for frame in step.frames if (out := self.fault(frame)) is not None]
        due = [frame for frame in self.held if frame.t_ns <= now_ns]
        self.held = [frame for frame in self.held if frame.t_ns > now_ns]
        wake_ns = min([step.wake_ns, *(frame.t_ns for frame in self.held)])
        return Step(due, (), wake_ns)


def device(eds="skin-patch"):
    return Device(load_eds(eds, NODE), NODE, storage=MemoryStorage())


def check(board, eds="skin-patch", wire=None, rules=RULES):
    """Return what came of each rule by its name."""
    wire = wire or VirtualBus(1_000_000, data_bitrate=2_000_000)
    wire.attach(board)
    core = PatchCheck(CheckedPatch(NODE, load_eds(eds, NODE), 5 * MS), rules, destructive=True)
    wire.attach(core)
    wire.run(wire.now_ns + LIMIT_NS)
    assert [result.rule for result in core.results] == list(rules)
    return {result.rule.name: result.finding for result in core.results}


def fails(findings):
    return {name for name, finding in findings.items() if finding.grade is Grade.FAIL}


@pytest.mark.parametrize("eds", BOARDS)
def test_our_own_boards_pass_every_rule(eds):
    findings = check(device(eds), eds)
    assert fails(findings) == set(), findings
    assert {finding.grade for finding in findings.values()} == {Grade.PASS}


def test_a_board_with_noise_that_samples_at_each_sync_passes():
    assert fails(check(Board(device(), samples_at_every(1)))) == set()


def test_stored_parameters_are_kept_unless_their_loss_is_accepted():
    wire = VirtualBus()
    board = device()
    wire.attach(board)
    core = PatchCheck(CheckedPatch(NODE, load_eds("skin-patch", NODE), 5 * MS), RULES)
    wire.attach(core)
    wire.run(LIMIT_NS)
    assert core.passed
    assert [r.rule.name for r in core.results if r.finding.grade is Grade.SKIPPED] == ["storage"]
    # and what the rules have changed is gone: the board was reset last
    assert board.get(0x1017) == 500
    assert board.get(0x1020, 1) == 0


def is_tpdo(frame):
    return frame.can_id in (0x185, 0x285, 0x385, 0x485)


def spoil(test, **changes):
    return lambda frame: frame._replace(**changes) if test(frame) else frame


def lose(test):
    return lambda frame: None if test(frame) else frame


def is_boot_up(frame):
    return frame.can_id == 0x705 and frame.data == b"\0"


def is_abort(frame):
    return frame.can_id == 0x585 and frame.data[:1] == b"\x80"


def late(ms):
    return lambda frame: frame._replace(t_ns=frame.t_ns + ms * MS) if frame.can_id == 0x485 else frame


def samples_at_every(period):
    """Readings with noise; a new sample at every so many SYNCs."""
    n, sent, rng = 0, {}, np.random.default_rng(5)

    def fault(frame):
        nonlocal n
        if not is_tpdo(frame):
            return frame
        n += frame.can_id == 0x185
        if (n - 1) % period == 0:
            sent[frame.can_id] = rng.integers(-40, 40, 4).astype("<i2").tobytes()
        return frame._replace(data=sent[frame.can_id])

    return fault


def beats_late():
    """Every second heartbeat comes 40 ms late."""
    n = 0

    def fault(frame):
        nonlocal n
        if frame.can_id != 0x705 or is_boot_up(frame):
            return frame
        n += 1
        return frame._replace(t_ns=frame.t_ns + 40 * MS * (n % 2))

    return fault


BROKEN = {
    "no boot-up": (lose(is_boot_up), {"boot-up"}),
    "heartbeat off its period": (beats_late(), {"heartbeat"}),
    "a TPDO is missing": (lose(lambda f: f.can_id == 0x385), {"readings"}),
    "a TPDO is late": (late(8), {"readings"}),
    "it samples at every second SYNC": (samples_at_every(2), {"readings"}),
    "it samples at every sixth SYNC": (samples_at_every(6), {"readings"}),
    "a TPDO is too short": (spoil(lambda f: f.can_id == 0x185, data=bytes(6)), {"readings"}),
    "no EMCY": (lose(lambda f: f.can_id == 0x85), {"EMCY"}),
    "no LSS": (lose(lambda f: f.can_id == 0x7E4), {"LSS"}),
    "wrong abort codes": (
        lambda f: f._replace(data=f.data[:4] + b"\0\0\0\x08") if is_abort(f) else f,
        {"SDO aborts"},
    ),
}


@pytest.mark.parametrize(("fault", "rules"), BROKEN.values(), ids=BROKEN)
def test_broken_board_fails_its_rule_and_no_other(fault, rules):
    assert fails(check(Board(device(), fault))) == rules


def test_a_board_that_ignores_stop_fails():
    findings = check(Board(device(), deaf=lambda f: f.can_id == 0 and f.data[:1] == b"\x02"))
    assert fails(findings) == {"states", "stopped"}


def test_another_board_is_not_the_one_of_the_eds():
    findings = check(device("skin-patch-8bit"), "skin-patch")
    assert {"identity", "PDO parameters", "readings"} <= fails(findings)
    assert "0x1018:02" in findings["identity"].detail


def test_readings_off_their_zero_or_not_adjusted_are_found(tmp_path):
    head, mark, rest = find_eds("skin-patch").read_text().partition("ParameterName=Bits\n")
    own = tmp_path / "own.eds"  # a converter of 12 bits
    own.write_text(head + mark + rest.replace("DefaultValue=16", "DefaultValue=12", 1))
    board = device(own)
    board.step(0)
    board.image_view(0x6401, 1, 16)[:] = 0
    board.image_view(0x6401, 1, 16)[3] = 0x3001
    findings = check(board, own)
    assert fails(findings) == {"left-adjusted", "at rest"}
    assert findings["left-adjusted"].detail.startswith("reading 4 is")


def test_without_storage_that_rule_fails():
    findings = check(Device(load_eds("skin-patch", NODE), NODE))
    assert fails(findings) == {"storage"}


def test_nobody_there_fails_and_ends():
    findings = check(Board(device(), lambda frame: None))
    assert fails(findings) >= {"boot-up", "identity", "heartbeat", "readings", "EMCY", "LSS", "storage"}
