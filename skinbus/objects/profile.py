"""Names of skinbus's own objects, as the EDS files spell them; indices are looked up, never typed."""

from __future__ import annotations

from enum import IntFlag
from typing import NamedTuple

from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable


class Name(NamedTuple):
    """ParameterName of an object, and of a sub-object within it if it is a record."""

    object: str
    member: str = ""

    def __str__(self) -> str:
        return f"{self.object}/{self.member}" if self.member else self.object


# --- Patch -----------------------------------------------------------------------------------------
TACTEL_COUNT = Name("Board", "Tactel count")
WIDTH_UM = Name("Board", "Width um")
HEIGHT_UM = Name("Board", "Height um")
TACTEL_DIAMETER_UM = Name("Board", "Tactel diameter um")
TACTEL_U_UM = Name("Tactel u um")
TACTEL_V_UM = Name("Tactel v um")
FULL_SCALE_PA = Name("Transducer", "Full scale Pa")
TRANSDUCER_BITS = Name("Transducer", "Bits")
TACTEL_GAIN = Name("Tactel gain")
TACTEL_OFFSET = Name("Tactel offset")
LAW_KIND = Name("Contact law", "Law kind")
CONE_SLOPE = Name("Contact law", "Cone slope")
FORCE_EXPONENT = Name("Contact law", "Force exponent")
RADIAL_STEP_UM = Name("Contact law", "Radial step um")
RADIAL_POINTS = Name("Contact law", "Radial points")
RADIAL_LAW = Name("Radial law")
LAW_MISFIT = Name("Contact law", "Law misfit")
TYPICAL_FORCE = Name("Contact law", "Typical force")
MISFIT_PROFILE = Name("Misfit profile")
TACTEL_WIDTH = Name("Tactel width")
TACTEL_BIAS_PA = Name("Tactel bias Pa")
RESIDUAL_MAP = Name("Residual map")
TOUCH_PA = Name("Thresholds", "Touch Pa")
RELEASE_PA = Name("Thresholds", "Release Pa")
NOISE_PA = Name("Thresholds", "Noise Pa")
ZERO_BAND_PA = Name("Thresholds", "Zero band Pa")
ZERO_DRIFT_PA = Name("Thresholds", "Zero drift Pa")
TACTEL_NOISE_PA = Name("Tactel noise Pa")
HEALTHY_TACTELS = Name("Healthy tactels")
COMMAND = Name("Command")
COMMUNICATION_CHECKSUM = Name("Communication checksum")
"""What a board holds now, see ``dcf.checksum``; boards of others need not have it."""
SAMPLE_COUNTER = Name("Sampling", "SYNC counter of sample")
SAMPLE_STATUS = Name("Sampling", "Sample status")
SAMPLE_AGE = Name("Sampling", "Sample age 100us")
"""Time from sampling to the SYNC; AGE_STEP_NS each, 0xFFFF for that or more."""
AGE_STEP_NS = 100_000
FRAME_BYTES = Name("Board", "Frame bytes")
"""Most bytes of a PDO of a board on CAN FD; others do not have it."""


class SampleStatus(IntFlag):
    """Bits of "Sample status": why the readings of a frame are not those of its SYNC, or are doubtful."""

    OLD = 0x01
    """Sampled before the SYNC, nobody knows when: the converter was not ready, or has stopped."""
    UNSETTLED = 0x02
    """The converter or its supply has not settled since the start."""
    ERROR = 0x04
    """The error register (0x1001) is not 0."""


# --- Master ----------------------------------------------------------------------------------------
CYCLES = Name("Cycle", "Cycles")
OVERRUNS = Name("Cycle", "Overruns")
LEVEL = Name("Cycle", "Level")
CUT_SHORT = Name("Cycle", "Cut short")
FRAMES_ACCEPTED = Name("Frames", "Accepted")
FRAMES_UNKNOWN = Name("Frames", "Unknown")
FRAMES_BAD_LENGTH = Name("Frames", "Bad length")
FRAMES_LOST = Name("Frames", "Lost")
LOAD = Name("Load", "Force")
LOAD_SD = Name("Load", "Force sd")
LOAD_AREA = Name("Load", "Touched area")
PATCH_LOAD = Name("Patch load")
PATCH_LOAD_SD = Name("Patch load sd")
PATCH_AREA = Name("Patch touched area")
LINK_LOAD = Name("Link load")
LINK_LOAD_SD = Name("Link load sd")
LINK_LOAD_S = Name("Link load s")
LINK_LOAD_A = Name("Link load a")
LINK_LOAD_PLACE_SD = Name("Link load place sd")
LINK_AREA = Name("Link touched area")
PATCH_STATE = Name("Patch state")
PATCH_AGE_MS = Name("Patch age ms")
PATCH_ERROR = Name("Patch error")
PATCH_COMMAND = Name("Patch command")
PATCH_SUSPECT = Name("Patch suspect tactels")
PATCH_FAULTY = Name("Patch implausible tactels")
PATCH_FAULTY_COUNT = Name("Patch implausible count")
FAULTY = Name("Cycle", "Implausible tactels")

MASTER_NODE_ID = 127
"""Of the master unless another is given."""

ZERO = int.from_bytes(b"zero", "little")
"""Value of a command: take what the tactels read now as zero; a word, so that no slip of the hand does it."""

ROBOT_VALID = Name("Robot", "Valid")
ROBOT_JOINTS = Name("Robot", "Joint count")
ROBOT_WRENCH = Name("Robot", "Base force x")
"""The first of six."""
JOINT_POSITION = Name("Joint position")
JOINT_TORQUE = Name("Joint torque")
JOINT_TORQUE_DEVIATION = Name("Joint torque deviation")
JOINT_TORQUE_COUNTS = Name("Joint torque 0.01")
"""In 0.01 N m or 0.01 N; ``TORQUE_INVALID`` where it is not valid."""
TORQUE_STEP = 0.01
TORQUE_INVALID = -0x8000
MAX_JOINTS = 16
"""Elements of these arrays."""

# --- Records of contacts ---------------------------------------------------------------------------
MAX_CONTACTS = 16
"""Contact records, and TPDOs for them, of the master."""

CONTACT_MEMBERS = ("Id", "Link and state", "s 0.1mm", "a 0.1mm", "Force 0.01N")
"""Members of a contact record that its TPDO carries, in the order of their sub-indices."""


def contact(number: int, member: str = "") -> Name:
    """Return the name of contact record ``number`` (from 1), or of one member of it."""
    return Name(f"Contact {number}", member)


def look_up(od: ObjectDictionary, name: Name) -> ODVariable:
    """Return the variable behind a name.

    Raises:
        KeyError: the dictionary has no such variable; the message says the name.
    """
    found = od.names.get(name.object)
    if name.member and isinstance(found, ODRecord | ODArray):
        found = found.names.get(name.member)
    if not isinstance(found, ODVariable):
        raise KeyError(f"no variable {str(name)!r} in the object dictionary")
    return found


def look_up_array(od: ObjectDictionary, name: Name) -> list[ODVariable]:
    """Return the elements of an array (or record), sub-index 1 first.

    Raises:
        KeyError: the dictionary has no such array.
    """
    found = od.names.get(name.object)
    if name.member or not isinstance(found, ODArray | ODRecord):
        raise KeyError(f"no array {str(name)!r} in the object dictionary")
    return [found.subindices[sub] for sub in sorted(found.subindices) if sub > 0]


def index_of(od: ObjectDictionary, name: Name) -> tuple[int, int]:
    """Return index and sub-index of a variable; of a whole array, its index and 0."""
    if name.member:
        variable = look_up(od, name)
        return variable.index, variable.subindex
    if name.object not in od.names:
        raise KeyError(f"no object {str(name)!r} in the object dictionary")
    return od.names[name.object].index, 0


def has(od: ObjectDictionary, name: Name) -> bool:
    """Return whether a dictionary has an object, and the member of it that is named."""
    found = od.names.get(name.object)
    return found is not None and (not name.member or name.member in getattr(found, "names", ()))


def current(variable: ODVariable) -> int | float | str | bytes | None:
    """Return what a variable holds by its file: ParameterValue of a DCF if there is one, else the default."""
    return variable.default if variable.value is None else variable.value


def number_at(od: ObjectDictionary, index: int, sub: int = 0) -> int:
    """Return the number that a dictionary holds by its file, 0 when it has none there."""
    variable = od.get_variable(index, sub)
    return 0 if variable is None else int(current(variable) or 0)
