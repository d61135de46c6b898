"""A CANopen device without I/O, clock or thread: NMT, SDO server, PDO engine, EMCY, heartbeat."""

from skinbus.node.device import Device
from skinbus.node.host import PatchHost, Sample, Source
from skinbus.node.sdo_client import SdoClient, SdoResult

__all__ = ["Device", "PatchHost", "Sample", "SdoClient", "SdoResult", "Source"]
