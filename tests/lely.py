"""Files as lely's dcf-tools read them: they take a REAL32 for its bits, where all others write a decimal."""

import re
import struct
import subprocess
import sys

from skinbus.objects.eds import find_eds

_VALUE = re.compile(r"(?m)^(DefaultValue|ParameterValue|LowLimit|HighLimit)=(?!0x)(\S+)$")
_REAL32 = re.compile(r"(?m)^DataType=0x0008$")


def for_lely(source, folder):
    """Write a copy of an EDS or DCF with the bits of its REAL32 values; return its path."""
    path = find_eds(source)

    def bits(match):
        (number,) = struct.unpack("<I", struct.pack("<f", float(match[2])))
        return f"{match[1]}=0x{number:08X}"

    parts = re.split(r"(?m)^(?=\[)", path.read_text())
    parts = [_VALUE.sub(bits, part) if _REAL32.search(part) else part for part in parts]
    copy = folder / "lely" / path.name
    copy.parent.mkdir(exist_ok=True)
    copy.write_text("".join(parts))
    return copy


def dcfchk(source, folder, node_id=5):
    """Run lely's checker on a copy of a file; return what came of it."""
    command = [sys.executable, "-m", "dcf.cli", "-n", str(node_id)]
    return subprocess.run([*command, for_lely(source, folder)], capture_output=True, text=True, check=False)


def assert_clean(source, folder):
    """Hold a file against lely's checker."""
    run = dcfchk(source, folder)
    assert (run.returncode, run.stderr) == (0, "")
