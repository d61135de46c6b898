"""A CANopen device without I/O, clock or thread: NMT, SDO server, PDO engine, EMCY, heartbeat."""

from skinbus.node.device import Device
from skinbus.node.layout import image_size
from skinbus.node.sdo_client import SdoClient, SdoResult

__all__ = ["Device", "SdoClient", "SdoResult", "image_size"]
