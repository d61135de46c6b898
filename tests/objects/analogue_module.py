"""The EDS of an analogue module of eight inputs after CiA 404, laid out as that of a SYS TEC IO-X4 8AI."""

INTEGER16, UNSIGNED8, UNSIGNED16, UNSIGNED32 = 3, 5, 6, 7
N_INPUTS = 8
IDENTITY = {1: 63, 2: 3001003, 3: 0x01390538}

HEAD = """[FileInfo]
FileName=eight-inputs.eds
FileVersion=1
FileRevision=1
EDSVersion=4.0
Description=eight analogue inputs

[DeviceInfo]
VendorName=nobody
VendorNumber=63
ProductName=eight analogue inputs
ProductNumber=3001003
RevisionNumber=0x01390538
BaudRate_1000=1
SimpleBootUpSlave=1
Granularity=8
NrOfRXPDO=0
NrOfTXPDO=4
LSS_Supported=0

[DummyUsage]
Dummy0001=0
"""


def variable(section, name, data_type, access, default=None, mapped=False):
    """A section of an object with one value."""
    lines = [f"[{section}]", f"ParameterName={name}", "ObjectType=0x7", f"DataType=0x{data_type:04X}"]
    lines += [f"AccessType={access}", f"PDOMapping={int(mapped)}"]
    return "\n".join(lines + ([] if default is None else [f"DefaultValue={default}"])) + "\n"


def group(index, name, members, kind=0x9):
    """Sections of a record or an array: members as those of ``variable``, by sub-index."""
    text = f"[{index:04X}]\nParameterName={name}\nObjectType=0x{kind:X}\nSubNumber={len(members) + 1}\n\n"
    text += variable(f"{index:04X}sub0", "Number of entries", UNSIGNED8, "ro", max(members))
    return text + "".join("\n" + variable(f"{index:04X}sub{sub:X}", *m) for sub, m in members.items())


def mapping(number):
    """What TPDO ``number`` maps: value and status of two inputs."""
    entries = [
        entry for k in (2 * number - 1, 2 * number) for entry in (0x71300010 | k << 8, 0x61500008 | k << 8)
    ]
    members = {k: (f"Entry {k}", UNSIGNED32, "rw", hex(e)) for k, e in enumerate([*entries, 0, 0, 0, 0], 1)}
    text = group(0x1A00 + number - 1, f"TPDO {number} mapping", members)
    return text.replace(
        "AccessType=ro\nPDOMapping=0\nDefaultValue=8", "AccessType=rw\nPDOMapping=0\nDefaultValue=4", 1
    )


def module_eds():
    """The text."""
    parts = {
        0x1000: variable("1000", "Device type", UNSIGNED32, "ro", "0x20194"),
        0x1001: variable("1001", "Error register", UNSIGNED8, "ro", 0),
        0x1018: group(
            0x1018, "Identity", {k: (f"Number {k}", UNSIGNED32, "ro", v) for k, v in IDENTITY.items()}
        ),
        0x1005: variable("1005", "COB-ID SYNC", UNSIGNED32, "rw", "0x80"),
        0x1007: variable("1007", "Synchronous window length", UNSIGNED32, "rw", 0),
        0x1014: variable("1014", "COB-ID EMCY", UNSIGNED32, "rw", "$NODEID+0x80"),
        0x1017: variable("1017", "Producer heartbeat time", UNSIGNED16, "rw", 0),
    }
    for number in range(1, 5):
        parts[0x1800 + number - 1] = group(
            0x1800 + number - 1,
            f"TPDO {number}",
            {
                1: ("COB-ID", UNSIGNED32, "rw", f"$NODEID+0x{0x80 + 0x100 * number:X}"),
                2: ("Transmission type", UNSIGNED8, "rw", 255),
                3: ("Inhibit time", UNSIGNED16, "rw", 500),
                5: ("Event timer", UNSIGNED16, "rw", 0),
            },
        ).replace("SubNumber=5", "SubNumber=5")
        parts[0x1A00 + number - 1] = mapping(number)
    inputs = range(1, N_INPUTS + 1)
    parts[0x6150] = group(
        0x6150, "AI status", {k: (f"Status {k}", UNSIGNED8, "ro", 0, True) for k in inputs}, 0x8
    )
    parts[0x7130] = group(
        0x7130, "AI input PV", {k: (f"Value {k}", INTEGER16, "ro", 0, True) for k in inputs}, 0x8
    )
    parts[0x2001] = variable("2001", "Temperature", INTEGER16, "ro", 0)
    mandatory = [0x1000, 0x1001, 0x1018]
    lists = {
        "MandatoryObjects": mandatory,
        "OptionalObjects": sorted(i for i in parts if i not in mandatory and not 0x2000 <= i < 0x6000),
        "ManufacturerObjects": [0x2001],
    }
    text = HEAD
    for name, objects in lists.items():
        lines = "".join(f"{k}=0x{index:04X}\n" for k, index in enumerate(objects, 1))
        text += f"\n[{name}]\nSupportedObjects={len(objects)}\n{lines}"
    return text + "".join(f"\n{parts[index]}" for index in sorted(parts))
