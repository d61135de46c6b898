"""The boot script of one patch: what it asks, in which order, and how it ends."""

import pytest

from skinbus.master.boot import Identity, Reply, Request, boot
from skinbus.objects import cia

IDENTITY = Identity(device_type=0x40191, vendor=0x1234, product=1, revision=0x10002, serial=77)
ANSWERS = {
    (cia.DEVICE_TYPE, 0): 0x40191,
    (cia.IDENTITY, 1): 0x1234,
    (cia.IDENTITY, 2): 1,
    (cia.IDENTITY, 3): 0x10002,
    (cia.IDENTITY, 4): 77,
}


def converse(identity, answers):
    """Play the device that gives these answers; return the requests it saw and the verdict."""
    script, asked = boot(identity), []
    request = next(script)
    while True:
        asked.append(request)
        reply = answers.get((request.index, request.sub), cia.AbortCode.NO_OBJECT)
        is_abort = isinstance(reply, cia.AbortCode)
        try:
            request = script.send(Reply(abort=reply) if is_abort else Reply(reply.to_bytes(4, "little")))
        except StopIteration as end:
            return asked, end.value


def test_right_device_is_accepted_after_all_five_checks():
    asked, verdict = converse(IDENTITY, ANSWERS)
    assert verdict.accepted
    assert asked == [Request(*key) for key in ANSWERS]


def test_identity_of_zero_asks_only_for_the_device_type():
    asked, verdict = converse(Identity(), ANSWERS)
    assert verdict.accepted
    assert asked == [Request(cia.DEVICE_TYPE, 0)]


@pytest.mark.parametrize("key", list(ANSWERS))
def test_one_wrong_value_is_refused_and_said(key):
    _, verdict = converse(IDENTITY, ANSWERS | {key: 0x55})
    assert not verdict.accepted
    assert verdict.answered
    assert "0x55" in verdict.reason


def test_silence_is_told_from_refusal():
    _, silent = converse(IDENTITY, ANSWERS | {(cia.DEVICE_TYPE, 0): cia.AbortCode.TIMEOUT})
    _, refused = converse(IDENTITY, ANSWERS | {(cia.IDENTITY, 4): cia.AbortCode.NO_SUB_INDEX})
    assert not silent.answered
    assert refused.answered
