"""A drive on the bus: an EDS that maps its position, and a core that sends it after each SYNC."""

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame


def variable(section, name, data_type, access, default, mappable=0):
    return (
        f"[{section}]\nParameterName={name}\nObjectType=0x7\nDataType=0x{data_type:04X}\n"
        f"AccessType={access}\nDefaultValue={default}\nPDOMapping={mappable}\n\n"
    )


def record(index, name, subs):
    text = f"[{index}]\nParameterName={name}\nObjectType=0x9\nSubNumber={len(subs) + 1}\n\n"
    text += variable(f"{index}sub0", "Highest sub-index supported", 5, "const", len(subs))
    return text + "".join(variable(f"{index}sub{k}", *sub) for k, sub in enumerate(subs, 1))


def drive_eds(mapping=(0x60410010, 0x60640020), kind=1, cob_id="$NODEID+0x40000180", rpdo=None, more=None):
    """The text of an EDS with these objects in TPDO 1; RPDO 1 and a TPDO 2 like the first, if named."""
    objects = ["1800", "1A00", "6041", "6064", "6040"]
    objects += (["1400", "1600"] if rpdo else []) + (["1801", "1A01"] if more else [])
    return (
        "[FileInfo]\nFileName=drive.eds\nFileVersion=1\nFileRevision=0\nEDSVersion=4.0\n\n"
        "[DeviceInfo]\nVendorName=x\nVendorNumber=1\nProductName=drive\nProductNumber=1\nRevisionNumber=1\n"
        "BaudRate_1000=1\nSimpleBootUpSlave=1\nGranularity=8\n"
        f"NrOfRXPDO={int(bool(rpdo))}\nNrOfTXPDO={1 + bool(more)}\nLSS_Supported=0\n\n"
        "[MandatoryObjects]\nSupportedObjects=3\n1=0x1000\n2=0x1001\n3=0x1018\n\n"
        + variable("1000", "Device type", 7, "const", "0x00020192")
        + variable("1001", "Error register", 5, "ro", 0, 1)
        + record("1018", "Identity object", [("Vendor-ID", 7, "const", 1)])
        + "[OptionalObjects]\n"
        + numbered(objects)
        + pdo("TPDO", 1, cob_id, kind, mapping)
        + (pdo("TPDO", 2, f"0x{more | 0x40000000:X}", kind, mapping) if more else "")
        + (pdo("RPDO", 1, rpdo, 255, (0x60400010,)) if rpdo else "")
        + variable("6040", "Controlword", 6, "rw", 0, 1)
        + variable("6041", "Statusword", 6, "ro", 0, 1)
        + variable("6064", "Position actual value", 4, "ro", 0, 1)
    )


def numbered(objects):
    lines = [f"{k}=0x{index}" for k, index in enumerate(objects, 1)]
    return "\n".join([f"SupportedObjects={len(lines)}", *lines, "", ""])


def pdo(direction, number, cob_id, kind, mapping):
    """The text of a PDO."""
    first = {"RPDO": 0x1400, "TPDO": 0x1800}[direction] + number - 1
    parameters = [(f"COB-ID used by {direction}", 7, "rw", cob_id), ("Transmission type", 5, "rw", kind)]
    mapped = [(f"Object {k}", 7, "rw", f"0x{entry:08X}") for k, entry in enumerate(mapping, 1)]
    mapping = record(f"{first + 0x200:04X}", f"{direction} {number} mapping parameter", mapped)
    return record(
        f"{first:04X}", f"{direction} {number} communication parameter", parameters
    ) + mapping.replace("Highest sub-index supported", "Number of mapped application objects in PDO")


class Drive(Core):
    """Sends where a joint was at each SYNC, 0.5 ms later; ``counts`` is a function of the time in ns."""

    cob_ids = frozenset({0x80, 0x000})

    def __init__(self, node_id, counts):
        self.node_id, self.counts = node_id, counts
        self.commands = []
        self.is_silent = False
        self._due, self._value = NEVER, 0

    def step(self, now_ns, frames):
        for frame in frames:
            if frame.can_id == 0:
                self.commands.append(frame.data)
            elif frame.can_id == 0x80 and not self.is_silent:
                self._due, self._value = now_ns + 500_000, self.counts(now_ns)
        if now_ns < self._due:
            return Step((), (), self._due)
        self._due = NEVER
        data = b"\x37\x02" + int(self._value).to_bytes(4, "little", signed=True)
        return Step([Frame(0x180 + self.node_id, data)], (), NEVER)
