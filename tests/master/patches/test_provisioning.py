"""Provisioning of one patch at its boot: what is asked, in which order, and what it comes to."""

import pytest

from skinbus.master.commissioning.sessions import Reply, Request
from skinbus.master.patches.provisioning import (
    ExpectedNode,
    Identity,
    Provision,
    Provisioned,
    Task,
    provision,
)
from skinbus.objects import cia
from skinbus.objects.dcf import Configuration, Write

IDENTITY = Identity(device_type=0x40191, vendor=0x1234, product=1, revision=0x10002, serial=77)
IDENTITY_ANSWERS = {
    (cia.DEVICE_TYPE, 0): 0x40191,
    (cia.IDENTITY, 1): 0x1234,
    (cia.IDENTITY, 2): 1,
    (cia.IDENTITY, 3): 0x10002,
    (cia.IDENTITY, 4): 77,
}
DATE, TIME = (cia.VERIFY_CONFIGURATION, 1), (cia.VERIFY_CONFIGURATION, 2)
ERRORS = (cia.ERROR_REGISTER, 0)
ANSWERS = IDENTITY_ANSWERS | {DATE: 0, TIME: 0, ERRORS: 0}

NOTHING = Configuration(())
WRITES = (Write(0x2030, 1, b"\x01\x02\x03\x04"), Write(0x1800, 2, b"\x01"))
TWO_OBJECTS = Configuration(WRITES, date=11, time=22)


def converse(identity, answers, configuration=NOTHING, *, restored=False):
    """Play the device that gives these answers; return the requests it saw and the result."""
    plan = ExpectedNode(node_id=1, identity=identity, configuration=configuration)
    script, asked = provision(plan, Task.BOOT, is_restored=restored), []
    request = next(script)
    while True:
        asked.append(request)
        reply = answers.get((request.index, request.sub), cia.AbortCode.NO_OBJECT)
        is_abort = isinstance(reply, cia.AbortCode)
        data = b"" if is_abort or request.data is not None else reply.to_bytes(4, "little")
        try:  # a plain number: looked for in a range, an enum member counts up to itself
            request = script.send(Reply(data, int(reply) if is_abort else 0))
        except StopIteration as end:
            return asked, end.value


@pytest.mark.parametrize("key", list(IDENTITY_ANSWERS))
def test_one_wrong_value_is_refused_and_said(key):
    _, result = converse(IDENTITY, ANSWERS | {key: 0x55})
    assert result.outcome is Provision.REFUSED
    assert "0x55" in result.reason


def test_device_that_cannot_restore_is_written_over_or_refused():
    held = ANSWERS | {DATE: 10, TIME: 22, (cia.RESTORE_DEFAULTS, 1): cia.AbortCode.NO_OBJECT}
    _, result = converse(Identity(), held | {(w.index, w.sub): 0 for w in WRITES}, TWO_OBJECTS)
    assert result == Provisioned(Provision.CHANGED, n_written=2)
    _, result = converse(Identity(), held)
    assert result.outcome is Provision.REFUSED
    _, result = converse(Identity(), held | {(cia.RESTORE_DEFAULTS, 1): 0}, restored=True)
    assert result.outcome is Provision.REFUSED


def test_device_without_1020_is_configured_at_every_boot():
    held = {(cia.DEVICE_TYPE, 0): 0x40191} | {(w.index, w.sub): 0 for w in WRITES}
    _, result = converse(Identity(), held, TWO_OBJECTS)
    assert result == Provisioned(Provision.CHANGED, n_written=2)


@pytest.mark.parametrize(
    ("register", "kept", "error"),
    [
        (0, 0x5010, 0),
        (1, 0x00025010, 0x5010),  # the upper half is the manufacturer's
        (1, cia.AbortCode.NO_DATA, cia.EmcyCode.GENERIC),
        (1, 0, cia.EmcyCode.GENERIC),
        (cia.AbortCode.NO_OBJECT, 0x5010, 0),
    ],
)
def test_accepted_patch_is_asked_for_its_error(register, kept, error):
    _, result = converse(Identity(), ANSWERS | {ERRORS: register, (cia.ERROR_HISTORY, 1): kept})
    assert result == Provisioned(Provision.SAME, error=error)


WINDOW = Write(cia.SYNC_WINDOW, 0, (20_000).to_bytes(4, "little"))
CHECKSUM = (0x2060, 0)
WINDOWED = Configuration(
    WRITES,
    date=11,
    time=22,
    communication=(WINDOW,),
    checksum=5,
    checksum_index=CHECKSUM[0],
    window=WINDOW,
    checksum_before=4,
)
MARKED = ANSWERS | {DATE: 11, TIME: 22, WINDOW[:2]: 0}


def test_synchronous_window_is_set_with_one_download_and_the_marks_that_it_clears():
    asked, result = converse(Identity(), MARKED | {CHECKSUM: 4}, WINDOWED)
    assert result == Provisioned(Provision.SAME)
    marks = [Request(*DATE, (11).to_bytes(4, "little")), Request(*TIME, (22).to_bytes(4, "little"))]
    assert asked[3:] == [Request(*CHECKSUM), Request(*WINDOW), *marks, Request(*ERRORS)]


def test_device_that_refuses_the_synchronous_window_is_refused():
    held = ANSWERS | {DATE: 11, TIME: 22, CHECKSUM: 4, WINDOW[:2]: cia.AbortCode.VALUE_HIGH}
    _, result = converse(Identity(), held, WINDOWED)
    assert result.outcome is Provision.REFUSED
    assert "0x1007:00" in result.reason
