"""Ten thousand malformed and hostile frames leave the master serving: contacts, and SDO to any client."""

import random
import time

import canopen
import pytest

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.frame import EXTENDED, RTR, Frame
from tests.socketcan.can_rig import EDS
from tests.socketcan.skin_rig import Skin

SEED = 8
N = 10_000
READ_ONLY = (0x1000, 0x1001, 0x1018, 0x2100, 0x2200, 0x2300, 0x3001, 0x3010)

WRONG_LENGTH = (0x000, 0x080, 0x081, 0x181, 0x281, 0x381, 0x481, 0x581, 0x601, 0x67F, 0x701, 0x77F)
COLLIDING = (0x0FF, 0x181, 0x1FF, 0x481, 0x581, 0x5FF, 0x681, 0x690, 0x701, 0x77F)


def hostile_frame(rng):
    """One frame that nobody should send."""
    kind = rng.randrange(6)
    if kind == 0:
        return Frame(rng.choice(WRONG_LENGTH), rng.randbytes(rng.choice((0, 1, 3, 5, 7))))
    if kind == 1:
        head = bytes([rng.choice((0x21, 0x23, 0x2B, 0x2F)), *rng.choice(READ_ONLY).to_bytes(2, "little")])
        return Frame(rng.choice((0x67F, 0x601)), head + rng.randbytes(5))
    if kind == 2:
        return Frame(0x000, bytes([rng.choice((1, 2, 128, 129, 130, 77)), rng.choice((0, 1, 127, 200))]))
    if kind == 3:
        return Frame(rng.choice(COLLIDING), rng.randbytes(rng.choice((1, 2, 8))))
    if kind == 4:
        return Frame(rng.randrange(0x800), rng.randbytes(rng.randrange(9)), flags=RTR)
    return Frame(rng.randrange(1 << 29), rng.randbytes(rng.randrange(9)), flags=EXTENDED)


def assert_serves(skin, channel):
    """Any client reads the contact by SDO, and is refused what is read-only."""
    network = canopen.Network()
    network.connect(interface="socketcan", channel=channel)
    try:
        node = network.add_node(127, str(EDS / "skin-master.eds"))
        node.sdo.RESPONSE_TIMEOUT = 5.0
        assert node.sdo[0x1018][1].raw == skin.master.device.get(0x1018, 1)
        skin.wait_for(
            lambda: node.sdo["Contact 1"]["Force"].raw == pytest.approx(5.0, rel=0.5), "its force, by SDO"
        )
        with pytest.raises(canopen.SdoAbortedError):
            node.sdo.download(0x1000, 0, bytes(4))
    finally:
        network.disconnect()


def test_ten_thousand_hostile_frames_leave_the_master_serving(tmp_path, channel):
    rng = random.Random(SEED)
    with Skin(tmp_path, channel) as skin, SocketCanBus(channel) as attacker:
        for _ in range(N // 50):
            assert attacker.send([hostile_frame(rng) for _ in range(50)]) == 50
            time.sleep(0.002)  # the master meets them in the midst of its work, not in one heap
        over_s = time.monotonic()
        skin.wait_for(lambda: skin.pressed(over_s), "the contact")
        assert_serves(skin, channel)
