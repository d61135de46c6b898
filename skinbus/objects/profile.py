"""Names of skinbus's own objects, as the EDS files spell them; indices are looked up, never typed.

A name is that of an object, or RECORD/MEMBER; users write the same in the settings of a patch.
"""

from __future__ import annotations

from enum import IntFlag

from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable

# --- Patch -----------------------------------------------------------------------------------------
TACTEL_COUNT = "Board/Tactel count"
WIDTH_UM = "Board/Width um"
HEIGHT_UM = "Board/Height um"
TACTEL_DIAMETER_UM = "Board/Tactel diameter um"
TACTEL_U_UM = "Tactel u um"
TACTEL_V_UM = "Tactel v um"
FULL_SCALE_PA = "Transducer/Full scale Pa"
TRANSDUCER_BITS = "Transducer/Bits"
TACTEL_GAIN = "Tactel gain"
TACTEL_OFFSET = "Tactel offset"
LAW_KIND = "Contact law/Law kind"
CONE_SLOPE = "Contact law/Cone slope"
FORCE_EXPONENT = "Contact law/Force exponent"
RADIAL_STEP_UM = "Contact law/Radial step um"
RADIAL_POINTS = "Contact law/Radial points"
RADIAL_LAW = "Radial law"
LAW_MISFIT = "Contact law/Law misfit"
TYPICAL_FORCE = "Contact law/Typical force"
MISFIT_PROFILE = "Misfit profile"
TACTEL_WIDTH = "Tactel width"
TACTEL_BIAS_PA = "Tactel bias Pa"
RESIDUAL_MAP = "Residual map"
TOUCH_PA = "Thresholds/Touch Pa"
RELEASE_PA = "Thresholds/Release Pa"
NOISE_PA = "Thresholds/Noise Pa"
ZERO_BAND_PA = "Thresholds/Zero band Pa"
ZERO_DRIFT_PA = "Thresholds/Zero drift Pa"
TACTEL_NOISE_PA = "Tactel noise Pa"
HEALTHY_TACTELS = "Healthy tactels"
COMMAND = "Command"
COMMUNICATION_CHECKSUM = "Communication checksum"
"""What a board holds now, see ``dcf.checksum``; boards of others need not have it."""
SAMPLE_COUNTER = "Sampling/SYNC counter of sample"
SAMPLE_STATUS = "Sampling/Sample status"
SAMPLE_AGE = "Sampling/Sample age 100us"
"""Time from sampling to the SYNC; AGE_STEP_NS each, 0xFFFF for that or more."""
AGE_STEP_NS = 100_000
GUARD_STATE = "Guard/State"
"""Bits of ``guard.GuardState``."""
GUARD_TRIPPED_BY = "Guard/Tripped by"
"""Number of the tactel from 1; 0 is the sum, or nothing."""
GUARD_ACKNOWLEDGE = "Guard/Acknowledge"
GUARD_PERIOD_US = "Guard/Sampling period us"
GUARD_LIMITS = "Guard limits"
"""Bytes of ``guard.GuardLimits``; nothing is guarded while they are empty."""
FRAME_BYTES = "Board/Frame bytes"
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
CYCLES = "Cycle/Cycles"
FRAMES = "Frames"
"""By fate: accepted, unknown, of wrong length, lost."""
LOAD = "Load/Force"
PATCH_LOAD = "Patch load"
PATCH_LOAD_SD = "Patch load sd"
PATCH_AREA = "Patch touched area"
LINK_LOAD = "Link load"
LINK_LOAD_SD = "Link load sd"
LINK_LOAD_S = "Link load s"
LINK_LOAD_A = "Link load a"
LINK_LOAD_PLACE_SD = "Link load place sd"
LINK_AREA = "Link touched area"
PATCH_STATE = "Patch state"
PATCH_AGE_MS = "Patch age ms"
PATCH_ERROR = "Patch error"
PATCH_COMMAND = "Patch command"
PATCH_SUSPECT = "Patch suspect tactels"
PATCH_FAULTY = "Patch implausible tactels"
PATCH_FAULTY_COUNT = "Patch implausible count"

MASTER_NODE_ID = 127
"""Of the master unless another is given."""

ZERO = int.from_bytes(b"zero", "little")
"""Value of a command: take what the tactels read now as zero; a word, so that no slip of the hand does it."""

ACKNOWLEDGE = int.from_bytes(b"ackn", "little")
"""Value of "Guard/Acknowledge" that takes a trip of the guard back."""

ROBOT_VALID = "Robot/Valid"
ROBOT_JOINTS = "Robot/Joint count"
ROBOT_WRENCH = "Robot/Base force x"
"""The first of six."""
JOINT_POSITION = "Joint position"
MAX_JOINTS = 16
"""Elements of these arrays."""

# --- Records of contacts ---------------------------------------------------------------------------
MAX_CONTACTS = 16
"""Contact records, and TPDOs for them, of the master."""

CONTACT = "Contact 1"
"""The first of them."""

CONTACT_MEMBERS = ("Id", "Link and state", "s 0.1mm", "a 0.1mm", "Force 0.01N")
"""Members of a contact record that its TPDO carries, in the order of their sub-indices."""


def find(od: ObjectDictionary, name: str) -> ODVariable | ODArray | ODRecord | None:
    """Return the object behind a name, or the member of it that is named; None where there is none."""
    whole, _, member = name.partition("/")
    found = od.names.get(whole)
    return getattr(found, "names", {}).get(member) if member else found


def look_up(od: ObjectDictionary, name: str) -> ODVariable:
    """Return the variable behind a name.

    Raises:
        KeyError: the dictionary has no such variable; the message says the name.
    """
    found = find(od, name)
    if not isinstance(found, ODVariable):
        raise KeyError(f"no variable {name!r} in the object dictionary")
    return found


def look_up_array(od: ObjectDictionary, name: str) -> list[ODVariable]:
    """Return the elements of an array (or record), sub-index 1 first.

    Raises:
        KeyError: the dictionary has no such array.
    """
    found = find(od, name)
    if not isinstance(found, ODArray | ODRecord):
        raise KeyError(f"no array {name!r} in the object dictionary")
    return [found.subindices[sub] for sub in sorted(found.subindices) if sub > 0]


def index_of(od: ObjectDictionary, name: str) -> tuple[int, int]:
    """Return index and sub-index of a variable; of a whole array, its index and 0."""
    found = find(od, name)
    if found is None:
        raise KeyError(f"no object {name!r} in the object dictionary")
    return found.index, getattr(found, "subindex", 0)


def has(od: ObjectDictionary, name: str) -> bool:
    """Return whether a dictionary has an object, and the member of it that is named."""
    return find(od, name) is not None


def current(variable: ODVariable) -> int | float | str | bytes | None:
    """Return what a variable holds by its file: ParameterValue of a DCF if there is one, else the default."""
    return variable.default if variable.value is None else variable.value


def number_at(od: ObjectDictionary, index: int, sub: int = 0) -> int:
    """Return the number that a dictionary holds by its file, 0 when it has none there."""
    variable = od.get_variable(index, sub)
    return 0 if variable is None else int(current(variable) or 0)
