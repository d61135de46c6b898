"""What skinbus reads or writes in one direction only, in the other one: for tests in both directions."""

import struct

from canopen import ObjectDictionary
from canopen.objectdictionary import ODVariable

from skinbus.objects.dcf import Write

_HEAD = struct.Struct("<HBI")
"""CiA 302-3, 4.2: index, sub-index, length."""


def join_mapping(index: int, sub: int, bits: int) -> int:
    """Return the mapping entry of an object (CiA 301, 7.5.2.36)."""
    return index << 16 | sub << 8 | bits


def from_concise(data: bytes) -> list[Write]:
    """Return the downloads in a concise DCF."""
    (count,), at = struct.unpack_from("<I", data), 4
    writes = []
    for _ in range(count):
        index, sub, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        writes.append(Write(index, sub, data[at : at + length]))
        at += length
    assert at == len(data)
    return writes


def differences(od: ObjectDictionary) -> list[ODVariable]:
    """Return the variables to which the file gives another value than they have at power-on."""
    objects = [[item] if isinstance(item, ODVariable) else item.values() for item in od.values()]
    every = [variable for item in objects for variable in item]
    return [v for v in every if v.value is not None and v.value != v.default]
