"""Reads entries of a master over SDO, from bytes to bytes."""

from skinbus.node.sdo_client import SdoClient

MASTER = 127


def read(master, index, sub):
    """Read an entry of the master over SDO, from bytes to bytes."""
    return transfer(master, lambda client: client.start_read(index, sub))


def transfer(master, start):
    client = SdoClient(MASTER)
    start(client)
    frames = client.step(0)
    while client.busy:
        step = master.device.step(0, frames)
        frames = client.step(0, step.frames)
    return client.result


def number(master, index, sub):
    return int.from_bytes(read(master, index, sub).unwrap(), "little")
