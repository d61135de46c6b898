"""Names of skinbus's own objects, as the EDS files spell them; indices are looked up, never typed."""

from __future__ import annotations

from enum import IntFlag
from typing import Final, NamedTuple

from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable


class Name(NamedTuple):
    """ParameterName of an object, and of a sub-object within it if it is a record."""

    object: str
    member: str = ""

    def __str__(self) -> str:
        return f"{self.object}/{self.member}" if self.member else self.object


# --- Patch -----------------------------------------------------------------------------------------
TACTEL_COUNT: Final = Name("Board", "Tactel count")
WIDTH_UM: Final = Name("Board", "Width um")
HEIGHT_UM: Final = Name("Board", "Height um")
TACTEL_DIAMETER_UM: Final = Name("Board", "Tactel diameter um")
TACTEL_U_UM: Final = Name("Tactel u um")
TACTEL_V_UM: Final = Name("Tactel v um")
FULL_SCALE_PA: Final = Name("Transducer", "Full scale Pa")
TRANSDUCER_BITS: Final = Name("Transducer", "Bits")
TACTEL_GAIN: Final = Name("Tactel gain")
TACTEL_OFFSET: Final = Name("Tactel offset")
LAW_KIND: Final = Name("Contact law", "Law kind")
CONE_SLOPE: Final = Name("Contact law", "Cone slope")
FORCE_EXPONENT: Final = Name("Contact law", "Force exponent")
RADIAL_STEP_UM: Final = Name("Contact law", "Radial step um")
RADIAL_POINTS: Final = Name("Contact law", "Radial points")
RADIAL_LAW: Final = Name("Radial law")
LAW_MISFIT: Final = Name("Contact law", "Law misfit")
TYPICAL_FORCE: Final = Name("Contact law", "Typical force")
MISFIT_PROFILE: Final = Name("Misfit profile")
TACTEL_WIDTH: Final = Name("Tactel width")
TACTEL_BIAS_PA: Final = Name("Tactel bias Pa")
RESIDUAL_MAP: Final = Name("Residual map")
TOUCH_PA: Final = Name("Thresholds", "Touch Pa")
RELEASE_PA: Final = Name("Thresholds", "Release Pa")
NOISE_PA: Final = Name("Thresholds", "Noise Pa")
ZERO_BAND_PA: Final = Name("Thresholds", "Zero band Pa")
ZERO_DRIFT_PA: Final = Name("Thresholds", "Zero drift Pa")
TACTEL_NOISE_PA: Final = Name("Tactel noise Pa")
HEALTHY_TACTELS: Final = Name("Healthy tactels")
COMMAND: Final = Name("Command")
COMMUNICATION_CHECKSUM: Final = Name("Communication checksum")
"""What a board holds now, see ``dcf.checksum``; boards of others need not have it."""
SAMPLE_COUNTER: Final = Name("Sampling", "SYNC counter of sample")
SAMPLE_STATUS: Final = Name("Sampling", "Sample status")
FRAME_BYTES: Final = Name("Board", "Frame bytes")
"""Most bytes of a PDO of a board on CAN FD; others do not have it."""


class SampleStatus(IntFlag):
    """Bits of "Sample status": why the readings of a frame are not those of its SYNC, or are doubtful."""

    OLD = 0x01
    """Sampled before the SYNC, by a converter that runs freely or was not ready."""
    UNSETTLED = 0x02
    """The converter or its supply has not settled since the start."""
    ERROR = 0x04
    """The error register (0x1001) is not 0."""


# --- Master ----------------------------------------------------------------------------------------
CYCLE_FLAGS: Final = Name("Cycle", "Cycle flags")
CYCLES: Final = Name("Cycle", "Cycles")
OVERRUNS: Final = Name("Cycle", "Overruns")
LEVEL: Final = Name("Cycle", "Level")
BUDGET_US: Final = Name("Cycle", "Budget us")
CUT_SHORT: Final = Name("Cycle", "Cut short")
FRAMES_ACCEPTED: Final = Name("Frames", "Accepted")
FRAMES_UNKNOWN: Final = Name("Frames", "Unknown")
FRAMES_BAD_LENGTH: Final = Name("Frames", "Bad length")
FRAMES_LOST: Final = Name("Frames", "Lost")
LOAD: Final = Name("Load", "Force")
LOAD_SD: Final = Name("Load", "Force sd")
LOAD_AREA: Final = Name("Load", "Touched area")
PATCH_LOAD: Final = Name("Patch load")
PATCH_LOAD_SD: Final = Name("Patch load sd")
PATCH_AREA: Final = Name("Patch touched area")
LINK_LOAD: Final = Name("Link load")
LINK_LOAD_SD: Final = Name("Link load sd")
LINK_LOAD_S: Final = Name("Link load s")
LINK_LOAD_A: Final = Name("Link load a")
LINK_LOAD_PLACE_SD: Final = Name("Link load place sd")
LINK_AREA: Final = Name("Link touched area")
PATCH_STATE: Final = Name("Patch state")
PATCH_AGE_MS: Final = Name("Patch age ms")
PATCH_ERROR: Final = Name("Patch error")
PATCH_COMMAND: Final = Name("Patch command")
PATCH_SUSPECT: Final = Name("Patch suspect tactels")
PATCH_FAULTY: Final = Name("Patch implausible tactels")
PATCH_FAULTY_COUNT: Final = Name("Patch implausible count")
FAULTY: Final = Name("Cycle", "Implausible tactels")

MASTER_NODE_ID: Final = 127
"""Of the master unless another is given."""

ZERO: Final = int.from_bytes(b"zero", "little")
"""Value of a command: take what the tactels read now as zero; a word, so that no slip of the hand does it."""

ROBOT_VALID: Final = Name("Robot", "Valid")
ROBOT_JOINTS: Final = Name("Robot", "Joint count")
ROBOT_WRENCH: Final = Name("Robot", "Base force x")
"""The first of six."""
JOINT_POSITION: Final = Name("Joint position")
JOINT_TORQUE: Final = Name("Joint torque")
JOINT_TORQUE_DEVIATION: Final = Name("Joint torque deviation")
JOINT_TORQUE_COUNTS: Final = Name("Joint torque 0.01")
"""In 0.01 N m or 0.01 N; ``TORQUE_INVALID`` where it is not valid."""
TORQUE_STEP: Final = 0.01
TORQUE_INVALID: Final = -0x8000
MAX_JOINTS: Final = 16
"""Elements of these arrays."""

# --- Records of contacts ---------------------------------------------------------------------------
MAX_CONTACTS: Final = 16
"""Contact records, and TPDOs for them, of the master."""

CONTACT_MEMBERS: Final = (
    "Id",
    "Link and state",
    "s 0.1mm",
    "a 0.1mm",
    "Force 0.01N",
    "Level",
    "Quality",
    "Tactels used",
    "Node-ID",
    "Age ms",
    "Time ns",
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "Variance s",
    "Covariance s a",
    "Variance a",
    "Covariance s force",
    "Covariance a force",
    "Variance force",
    "Residual",
    "s",
    "a",
    "Force",
    "Identity",
    "Velocity s",
    "Velocity a",
    "Filtered s",
    "Filtered a",
    "Filtered force",
    "Bus",
    "Base x",
    "Base y",
    "Base z",
    "Base nx",
    "Base ny",
    "Base nz",
    "Base fx",
    "Base fy",
    "Base fz",
    "Base variance x",
    "Base covariance x y",
    "Base covariance x z",
    "Base variance y",
    "Base covariance y z",
    "Base variance z",
    "Tool x",
    "Tool y",
    "Tool z",
    "Tool nx",
    "Tool ny",
    "Tool nz",
    "Tool fx",
    "Tool fy",
    "Tool fz",
    "Robot valid",
)
"""Members of a contact record in the order of their sub-indices; those without a unit are in SI units."""


def contact(number: int, member: str = "") -> Name:
    """Return the name of contact record ``number`` (from 1), or of one member of it."""
    if not 1 <= number <= MAX_CONTACTS:
        raise ValueError(f"contact {number}; wanted 1..{MAX_CONTACTS}")
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


def current(variable: ODVariable) -> int | float | str | bytes | None:
    """Return what a variable holds by its file: ParameterValue of a DCF if there is one, else the default."""
    return variable.default if variable.value is None else variable.value


def number_at(od: ObjectDictionary, index: int, sub: int = 0) -> int:
    """Return the number that a dictionary holds by its file, 0 when it has none there."""
    variable = od.get_variable(index, sub)
    return 0 if variable is None else int(current(variable) or 0)
