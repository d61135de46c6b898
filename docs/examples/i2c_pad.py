"""16 tactels on four ADS1115 of a Raspberry Pi: skinbus patch skin-patch --reader i2c_pad:read --node 5"""

import time

from smbus2 import SMBus  # type: ignore[import-not-found]  # pip install smbus2

BUS, CONVERTERS = SMBus(1), (0x48, 0x49, 0x4A, 0x4B)


def read() -> list[int]:
    """Return 16 counts; a converter that does not answer raises OSError, and the patch reports it."""
    counts: list[int] = []
    for channel in range(4):
        for address in CONVERTERS:  # one conversion of each, 860 a second, +-4.096 V
            BUS.write_i2c_block_data(address, 1, [0xC3 | channel << 4, 0xE3])
        time.sleep(0.0015)
        counts += [int.from_bytes(BUS.read_i2c_block_data(a, 0, 2), "big", signed=True) for a in CONVERTERS]
    return counts
