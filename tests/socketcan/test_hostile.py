"""Ten thousand malformed and hostile frames leave the master serving: contacts, and SDO to any client."""

import random
import time

from skinbus.bus.socketcan import SocketCanBus
from tests.socketcan.hostile import SEED, N, assert_serves, hostile_frame
from tests.socketcan.skin_rig import Skin


def test_ten_thousand_hostile_frames_leave_the_master_serving(tmp_path, channel):
    print("seed", SEED)
    rng = random.Random(SEED)
    with Skin(tmp_path, channel) as skin, SocketCanBus(channel) as attacker:
        for _ in range(N // 50):
            assert attacker.send([hostile_frame(rng) for _ in range(50)]) == 50
            time.sleep(0.002)  # the master meets them in the midst of its work, not in one heap
        over_s = time.monotonic()
        took_s = skin.wait_for(lambda: skin.pressed(over_s), "the contact")
        print(f"contacts again after {took_s:.2f} s")
        assert_serves(skin, channel)
