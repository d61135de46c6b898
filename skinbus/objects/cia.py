"""Numbers of CiA 301, 302 and 401: indices, identifiers, commands, states, error and abort codes.

A test checks that each index is in one of our EDS files; sub-indices of records are named beside them.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

from canopen.sdo.exceptions import SdoAbortedError

# --- CiA 301, 7.5: communication objects -----------------------------------------------------------
DEVICE_TYPE = 0x1000
ERROR_REGISTER = 0x1001
ERROR_HISTORY = 0x1003
SYNC_COB_ID = 0x1005
SYNC_PERIOD = 0x1006
SYNC_WINDOW = 0x1007
DEVICE_NAME = 0x1008
GUARD_TIME = 0x100C
LIFE_TIME_FACTOR = 0x100D
STORE_PARAMETERS = 0x1010
RESTORE_DEFAULTS = 0x1011
EMCY_COB_ID = 0x1014
EMCY_INHIBIT = 0x1015
HEARTBEAT_CONSUMER = 0x1016
HEARTBEAT_PRODUCER = 0x1017
IDENTITY = 0x1018
SYNC_COUNTER_OVERFLOW = 0x1019
VERIFY_CONFIGURATION = 0x1020
EMCY_CONSUMER = 0x1028
ERROR_BEHAVIOR = 0x1029
SDO_SERVER = 0x1200
RPDO_COMMUNICATION = 0x1400
RPDO_MAPPING = 0x1600
TPDO_COMMUNICATION = 0x1800
TPDO_MAPPING = 0x1A00

# --- CiA 302-2 and 302-3: the master's view of the network -----------------------------------------
CONCISE_DCF = 0x1F22
CONFIGURE = 0x1F25
EXPECTED_DATE = 0x1F26
EXPECTED_TIME = 0x1F27
NMT_STARTUP = 0x1F80
NMT_ASSIGNMENT = 0x1F81
REQUEST_NMT = 0x1F82
EXPECTED_DEVICE_TYPE = 0x1F84
EXPECTED_VENDOR = 0x1F85
EXPECTED_PRODUCT = 0x1F86
EXPECTED_REVISION = 0x1F87
EXPECTED_SERIAL = 0x1F88
BOOT_TIME = 0x1F89

PROGRAM_DATA = 0x1F50
PROGRAM_CONTROL = 0x1F51
PROGRAM_SOFTWARE = 0x1F56
FLASH_STATUS, FLASH_BUSY = 0x1F57, 1
PROGRAM_COMMANDS = PROGRAM_STOP, PROGRAM_START, PROGRAM_CLEAR, PROGRAM_CONFIRM = 0, 1, 3, 0x80
"""To 0x1F51, which answers with the last one, and with CONFIRM (of Zephyr) while a program is on trial."""

# --- CiA 401: analogue inputs ----------------------------------------------------------------------
READ_ANALOGUE_8 = 0x6400
READ_ANALOGUE_16 = 0x6401
ANALOGUE_TRIGGER = 0x6421
ANALOGUE_INTERRUPT_ENABLE = 0x6423
ANALOGUE_UPPER_LIMIT = 0x6424
ANALOGUE_LOWER_LIMIT = 0x6425
ANALOGUE_DELTA = 0x6426

PROCESS_VALUE_16 = 0x7130
"""Of CiA 404: analogue inputs of measuring devices."""

READINGS = (READ_ANALOGUE_16, READ_ANALOGUE_8, PROCESS_VALUE_16)
"""Arrays of readings, the wider first; sub-index k is tactel k - 1."""

MAX_PDOS = 512

# --- Sub-indices -----------------------------------------------------------------------------------
IDENTITY_VENDOR = 1
IDENTITY_PRODUCT = 2
IDENTITY_REVISION = 3
IDENTITY_SERIAL = 4
VERIFY_DATE = 1
VERIFY_TIME = 2
PDO_COB_ID = 1
PDO_TYPE = 2
PDO_INHIBIT = 3
PDO_EVENT_TIMER = 5
PDO_SYNC_START = 6
STORE_ALL = 1
STORE_COMMUNICATION = 2
STORE_APPLICATION = 3
STORE_MANUFACTURER = 4
ERROR_BEHAVIOR_COMMUNICATION = 1
LAST_ERROR = 1
"""The newest entry of 0x1003."""
REQUEST_NMT_ALL = 0x80
"""All nodes, where others are node-IDs."""

SIGNATURE_SAVE = 0x65766173  # "save", 7.5.2.13
SIGNATURE_LOAD = 0x64616F6C  # "load", 7.5.2.14

# --- COB-IDs, CiA 301 table 39 (the predefined connection set) -------------------------------------
MAX_NODE_ID = 127
NMT_COMMAND_ID = 0x000
ACTIVE_MASTER_ID = 0x071
"""Which master is active (CiA 302-2, flying master)."""
SYNC_ID = 0x080
EMCY_BASE = 0x080
TPDO_BASES = (0x180, 0x280, 0x380, 0x480)
"""Of TPDO 1-4; add the node-ID."""
RPDO_BASES = (0x200, 0x300, 0x400, 0x500)
"""Of RPDO 1-4; add the node-ID."""
SDO_SERVER_BASE = 0x580
"""From server to client; add the node-ID."""
SDO_CLIENT_BASE = 0x600
"""From client to server; add the node-ID."""
HEARTBEAT_BASE = 0x700
LSS_SLAVE_ID = 0x7E4
LSS_MASTER_ID = 0x7E5
BIT_RATES = {
    0: 1_000_000,
    1: 800_000,
    2: 500_000,
    3: 250_000,
    4: 125_000,
    6: 50_000,
    7: 20_000,
    8: 10_000,
}
"""Bit rate of each index of the standard table of CiA 305; 5 is reserved. They are those of CiA 301."""

LAST_PDO_ID = 0x6DF
"""Highest identifier of a PDO: those from here to the heartbeats are restricted (CiA 301, table 33)."""
COB_ID_INVALID = 1 << 31
COB_ID_NO_RTR = 1 << 30
COB_ID_PRODUCER = 1 << 30
"""The same bit in 0x1005 and 0x1012: the device produces SYNC, or TIME."""
COB_ID_EXTENDED = 1 << 29
COB_ID_MASK_11 = 0x7FF
COB_ID_MASK_29 = 0x1FFFFFFF

RESTRICTED_IDS = (
    range(0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x700),
    range(0x701, 0x800),
)
"""Identifiers that no PDO, SYNC, TIME or EMCY may take (CiA 301, table 40)."""


def restricted(can_id: int) -> bool:
    """Whether the identifier belongs to another service."""
    return any(can_id in ids for ids in RESTRICTED_IDS)


class NmtCommand(IntEnum):
    """Command specifiers of NMT (CiA 301, 7.2.8.3.1)."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(IntEnum):
    """States of NMT as heartbeats carry them (CiA 301, 7.2.8.3.2.2)."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class TransmissionType:
    """Transmission types of PDOs (CiA 301, tables 72 and 76)."""

    SYNC_ACYCLIC = 0
    SYNC_MAX = 240
    EVENT_MANUFACTURER = 254


class Trigger(IntFlag):
    """Bits of 0x6421 (CiA 401)."""

    UPPER = 0x01
    LOWER = 0x02
    DELTA = 0x04


class ErrorRegister(IntFlag):
    """Bits of 0x1001 (CiA 301, 7.5.2.2)."""

    GENERIC = 0x01
    CURRENT = 0x02
    VOLTAGE = 0x04
    TEMPERATURE = 0x08
    COMMUNICATION = 0x10
    PROFILE = 0x20
    MANUFACTURER = 0x80


class EmcyCode(IntEnum):
    """Error codes of EMCY that skinbus sends or names (CiA 301, table 26)."""

    NO_ERROR = 0x0000
    GENERIC = 0x1000
    HARDWARE = 0x5000
    SOFTWARE = 0x6000
    SOFTWARE_DATA_SET = 0x6300
    COMMUNICATION = 0x8100
    CAN_OVERRUN = 0x8110
    CAN_PASSIVE = 0x8120
    HEARTBEAT = 0x8130
    BUS_OFF_RECOVERED = 0x8140
    COB_ID_COLLISION = 0x8150
    PROTOCOL = 0x8200
    PDO_LENGTH = 0x8210
    PDO_LENGTH_EXCEEDED = 0x8220
    SYNC_LENGTH = 0x8240
    RPDO_TIMEOUT = 0x8250
    DEVICE_SPECIFIC = 0xFF00
    NOT_GUARDING = 0xFF01
    GUARD_TRIPPED = 0xFF02


class AbortCode(IntEnum):
    """Abort codes of SDO (CiA 301, table 22)."""

    TOGGLE = 0x05030000
    TIMEOUT = 0x05040000
    COMMAND = 0x05040001
    BLOCK_SIZE = 0x05040002
    SEQUENCE = 0x05040003
    CRC = 0x05040004
    MEMORY = 0x05040005
    ACCESS = 0x06010000
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_TOO_LONG = 0x06040042
    INCOMPATIBLE = 0x06040043
    HARDWARE = 0x06060000
    LENGTH = 0x06070010
    LENGTH_HIGH = 0x06070012
    LENGTH_LOW = 0x06070013
    NO_SUB_INDEX = 0x06090011
    VALUE_INVALID = 0x06090030
    VALUE_HIGH = 0x06090031
    VALUE_LOW = 0x06090032
    NOT_STORED = 0x08000020
    LOCAL_CONTROL = 0x08000021
    DEVICE_STATE = 0x08000022
    NO_DATA = 0x08000024


def describe_abort(code: int) -> str:
    """Return an abort code with its meaning, known or not."""
    return f"0x{code:08X} ({SdoAbortedError.CODES.get(code, 'unknown abort code')})"


EMCY_CLASSES = {
    0x10: "generic error",
    0x20: "current",
    0x21: "current at the input",
    0x22: "current inside",
    0x23: "current at the output",
    0x30: "voltage",
    0x31: "supply voltage",
    0x32: "voltage inside",
    0x33: "output voltage",
    0x40: "temperature",
    0x41: "ambient temperature",
    0x42: "temperature of the device",
    0x50: "hardware",
    0x60: "software",
    0x61: "firmware",
    0x62: "user software",
    0x63: "data set",
    0x70: "additional modules",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol",
    0x90: "external error",
    0xF0: "additional functions",
    0xFF: "device specific",
}
"""Classes of error codes by their upper byte (CiA 301, table 26)."""

SOURCE_STOPPED = b"stop"
"""Data of the EMCY of a patch (HARDWARE) without any healthy tactel."""
TACTELS_FAILED = b"part"
"""The same of one of which some are healthy; the others read the lowest value, at a rail."""

EMCY_WORDS = {
    (EmcyCode.HARDWARE, SOURCE_STOPPED): "no readings: their source has stopped",
    (EmcyCode.HARDWARE, TACTELS_FAILED): "some tactels have no readings",
    (EmcyCode.COMMUNICATION, SYNC_WINDOW.to_bytes(2, "little")): (
        "synchronous window missed: TPDOs were not ready in time, a slower rate_hz would help"
    ),
    (EmcyCode.CAN_OVERRUN, b""): "CAN overrun: frames were lost",
    (EmcyCode.CAN_PASSIVE, b""): "CAN error passive",
    (EmcyCode.HEARTBEAT, b""): "heartbeat or life guarding lost",
    (EmcyCode.BUS_OFF_RECOVERED, b""): "recovered from bus-off",
    (EmcyCode.COB_ID_COLLISION, b""): "another node sends with its COB-ID",
    (EmcyCode.PDO_LENGTH, b""): "PDO too short",
    (EmcyCode.PDO_LENGTH_EXCEEDED, b""): "PDO too long",
    (EmcyCode.SYNC_LENGTH, b""): "SYNC of a wrong length",
    (EmcyCode.GUARD_TRIPPED, b""): "the guard has tripped: a reading or their sum is above its limit",
    (EmcyCode.RPDO_TIMEOUT, b""): "RPDO did not come in time",
}
"""Codes, and how their data begins."""


def describe_emcy(code: int, data: bytes = b"") -> str:
    """Return an error code of EMCY with its meaning, known or not."""
    known = (words for (own, begin), words in EMCY_WORDS.items() if own == code and data.startswith(begin))
    upper = code >> 8
    kind = EMCY_CLASSES.get(upper) or EMCY_CLASSES.get(upper & 0xF0, "unknown")
    return f"0x{code:04X} ({next(known, kind)})"
