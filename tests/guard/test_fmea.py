"""Every fault of the table in docs/guard.md ends in a stop, in time, or is listed there as not seen."""

from pathlib import Path

import numpy as np
import pytest

from skinbus.can.frame import Frame
from skinbus.config.system import load_arm
from skinbus.guard.watch import Phase, RegionPeaks
from skinbus.objects.guard import GuardLimits
from tests.bus.cores import Repeater
from tests.guard.rig import GFC, LOST, MS
from tests.guard.whole import PLATE, Whole
from tests.master.misbehaving import Tool

PAGE = Path(__file__).parents[2] / "docs/guard.md"
TRIP, SILENCE, MASTER_DIES = 2, LOST // MS + 2, 1252
"""ms: after a press, the last sign of life of a patch, and the last one of the master."""
OTHER = GuardLimits(1, 1, 2**31 - 1, np.full(16, 32767), *np.ones((2, 16), int)).encode()
"""Limits that nothing exceeds."""


def press(whole):
    whole.press([3], 40.0)


def silence(whole, *can_ids):
    """Board 1 does not get these frames through; it is pressed."""
    whole.boards[0].says = lambda frame: frame.can_id not in can_ids
    press(whole)


def unhealthy(whole):
    whole.healthy = np.arange(48) != 3


def freeze(whole):
    whole.frozen_ns = whole.now_ns


def age(whole):
    whole.age_ns = 4 * MS


def no_power(whole):
    whole.wire(0).detach(whole.ports[0])


def bus_off(whole):
    whole.ports[0].error_counter = 256


def write_limits(whole, damage=0):
    """Somebody writes limits that nothing exceeds; then it is pressed."""
    whole.join(Tool(1, [(0x2081, 0, bytes([OTHER[0] ^ damage]) + OTHER[1:])]))
    whole.run(5)
    press(whole)


def write_unheard(whole):
    whole.device(0).set(0x2081, 0, OTHER)
    press(whole)


def babble(whole, can_id):
    """Somebody fills the bus; it is pressed."""
    whole.join(Repeater(Frame(can_id, bytes(8)), 100_000))
    press(whole)


def double(whole):
    whole.join(whole.board(0))


def master_dies(whole):
    for wire, port in zip(whole.wires.wires, whole.master_ports, strict=True):
        wire.detach(port)


def master_hangs(whole):
    """It beats, and zeros drift by 10 kPa in an hour that is not waited for."""
    master_dies(whole)
    whole.join(Repeater(Frame(0x77F, b"\x05"), 500 * MS))
    whole.press(np.arange(16), 10.0)


def deaf(whole):
    whole.plug.hears = lambda frame: False


def spread(whole, is_shared=True):
    """One contact of 50 N on both boards, which may have 60 N each; the region may have it for 0.5 s."""
    whole.press([0, 12, 16, 28], 25.0)
    for _ in range(60 * is_shared):
        whole.guard.contacts = RegionPeaks(whole.now_ns, [65.0], [0.0])
        whole.run(10)


def end(whole):
    whole.guard.is_ending = True


def kill(whole):
    whole.bus.detach(whole.guard_ports[0])
    press(whole)


def low(whole, kpa=0.0):
    """Tactel 5 reads as low as it can; the others are pressed."""
    whole.press(np.arange(16), kpa)
    whole.counts = np.where(np.arange(48) == 5, -0x8000, whole.counts)


def dead(whole):
    """Tactel 3 reads nothing, whatever presses on it."""
    whole.press([3], 0.0)


SEEN = {
    "readings are lost on the wire": (lambda w: silence(w, 0x181, 0x281, 0x381, 0x481), TRIP),
    "GFC is lost": (lambda w: silence(w, GFC), TRIP),
    "GFC and the state after it are lost": (lambda w: silence(w, GFC, 0x501), SILENCE),
    "a tactel is said to be unhealthy": (unhealthy, TRIP),
    "the source of readings is frozen": (freeze, 5),
    "samples are old": (age, TRIP),
    "a tactel is out, and others of its patch are pressed": (lambda w: low(w, 29.0), TRIP),
    "a tactel is out, and the master notices": (low, 2000),
    "a patch loses power, or its cable": (no_power, SILENCE),
    "a patch goes bus-off": (bus_off, SILENCE),
    "somebody resets a patch": (lambda w: w.say(Frame(0, b"\x81\x01")), SILENCE),
    "somebody makes a patch PRE-OPERATIONAL": (lambda w: w.say(Frame(0, b"\x80\x01")), SILENCE),
    "somebody writes other limits": (write_limits, SILENCE),
    "somebody writes damaged limits": (lambda w: write_limits(w, 1), SILENCE),
    "a node babbles": (lambda w: babble(w, 0x002), TRIP),
    "a node babbles with the identifier 0": (lambda w: babble(w, 0x000), SILENCE),
    "two boards have one node-ID": (double, 1000),
    "the master dies": (master_dies, MASTER_DIES),
    "the bus of the guard process is lost": (deaf, SILENCE),
    "the guard process is ended": (end, 10),
    "what stops the robot does not answer": (press, TRIP),
    "a contact is spread over several patches, with `--contacts`": (spread, 610),
}
UNSEEN = {
    "a contact is spread over several patches, without `--contacts`": lambda w: spread(w, is_shared=False),
    "a tactel is dead or frozen, and nobody has noticed": dead,
    "a touch on a patch without limits": lambda w: w.press([40], 40.0),
    "somebody writes other limits, and the master does not receive it": write_unheard,
    "the master hangs and still sends heartbeats, while zeros drift": master_hangs,
    "the guard process is killed (SIGKILL)": kill,
}
ELSEWHERE = {"a touch between boards, or on no skin", "a cover passes a force on late"}
"""Not seen either: no core has anything to see."""


@pytest.fixture
def whole(tmp_path):
    (tmp_path / "arm.toml").write_text(PLATE.replace("[arm]", "[arm]\nrate_hz = 10"))
    whole = Whole(load_arm(tmp_path / "arm.toml")).until_guarding()
    whole.run(700)  # and the master has heard of everybody
    return whole


@pytest.mark.parametrize("name", SEEN)
def test_a_fault_is_a_stop_in_time(whole, name):
    cause, within_ms = SEEN[name]
    begun_ns = whole.now_ns
    cause(whole)
    whole.run(begun_ns / MS + within_ms - whole.now_ns / MS)
    assert whole.guard.phase is Phase.STOPPED, name


def test_other_limits_of_a_patch_that_the_master_waits_to_boot_are_a_stop(whole):
    """Its boot-up messages were somebody else's: it still guards, and the master does not know."""
    whole.say(Frame(0x701, b"\0"))
    whole.run(200)
    whole.say(Frame(0x701, b"\0"))
    whole.until_guarding()
    write_limits(whole)
    whole.run(SILENCE)
    assert whole.guard.phase is Phase.STOPPED


def test_other_limits_of_a_patch_that_is_booted_and_waits_for_another_are_taken_back(whole):
    """What the master has read back is no longer what it holds when it starts."""
    whole.say(Frame(0, b"\x81\x02"))
    whole.run(3)
    whole.boards[1].says = lambda frame: False
    whole.say(Frame(0, b"\x81\x01"))
    whole.run(20)
    write_limits(whole)
    whole.repair()
    whole.until_guarding()
    assert whole.device(0).get(0x2081) != OTHER


@pytest.mark.parametrize("name", UNSEEN)
def test_what_is_listed_as_not_seen_is_no_stop(whole, name):
    UNSEEN[name](whole)
    whole.run(600)
    assert whole.guard.phase is Phase.GUARDING
    assert not whole.told_ns()


def test_the_page_has_every_fault_and_no_other():
    table = PAGE.read_text().split("<!-- faults -->")[1]
    told = {line.split("|")[1].strip(): line for line in table.splitlines() if line.startswith("| ")}
    del told["fault"]
    assert told.keys() == SEEN.keys() | UNSEEN.keys() | ELSEWHERE
    assert {name for name, line in told.items() if "not seen" in line} == UNSEEN.keys() | ELSEWHERE
