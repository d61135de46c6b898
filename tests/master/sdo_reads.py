"""Entries of a device over SDO, from bytes to bytes."""

from skinbus.node.sdo_client import SdoClient

MASTER = 127


def transfer(device, start):
    """Let our client, which ``start`` tells what to do, work on a device; return what came of it."""
    client = SdoClient(device.node_id)
    start(client)
    frames = client.step(0)
    while client.busy:
        step = device.step(0, frames)
        frames = client.step(0, step.frames)
    return client.result


def write(device, index, sub, data):
    """Write an entry; return what came of it."""
    return transfer(device, lambda client: client.start_write(index, sub, data))


def read(device, index, sub):
    """Read an entry; return its bytes."""
    return transfer(device, lambda client: client.start_read(index, sub)).unwrap()


def number(master, index, sub):
    """Read a number of a master."""
    return int.from_bytes(read(master.device, index, sub), "little")
