"""The file of a new board: a shipped EDS with another grid of tactels, or the EDS of an analogue module.

All that depends on the tactels is made anew: readings, triggers, positions, gains and the like, and the TPDOs
that carry the readings. Their identifiers are those of TPDO 1 to 4 of the predefined connection set, then
those that it gives to RPDO 1 to 4, which a board leaves off: no two boards clash, whatever their node-IDs
(CiA 301, 7.3.5). TPDO 9, that of the guard, takes the last of them where it is free.

A module of others does not have the objects that describe tactels: in its DCF they are constants that only
the master reads. What the module itself must be set are ParameterValues, which the master downloads: its
readings are sent on each SYNC, and it sends heartbeats.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from skinbus.arrays import Floats
from skinbus.can.fd import CLASSIC_BYTES, MAX_BYTES
from skinbus.errors import EdsError
from skinbus.model.patch import MAX_TACTELS
from skinbus.objects import cia
from skinbus.objects.dcf import dcf_text
from skinbus.objects.eds import build_od, find_eds
from skinbus.objects.eds_file import read_text
from skinbus.objects.eds_text import EdsText
from skinbus.objects.pdo import carries_readings, readings_in, tpdos

BASES = (*cia.TPDO_BASES, *cia.RPDO_BASES)
"""Identifiers of the TPDOs, less the node-ID."""

GUARD_BASE = 0x6B0
"""Of TPDO 9 where the readings take all of them: behind the TPDOs of the master, for node-ID 1 to 47."""

LEAST_PA = 1_000
MOST_PA = 100_000_000
"""Full scales from a light touch to a thousand times what a palm presses; as an UNSIGNED32 in the EDS."""

ROOM_UM = 1e3
"""Of a tactel to its neighbour: a sensing cell fills the pitch but for so much."""

MOST_M = 1.0
"""From the centre of a board to its tactels."""

PRODUCT = 0x6000
"""Product code of a board of others, until its maker gives it one."""

N_SHIPPED = 0x10
"""Tactels of the shipped boards; only arrays by tactel have so many elements."""

SAMPLING = (0x2070_01_08, 0x2070_02_08, 0x2070_03_10)
"""SYNC counter, status and age of the sample: mapped behind the readings of a TPDO where there is room.

On CAN FD two always are; on classic CAN the age comes first, since a counter in some TPDOs proves little."""

PLACE = 0x5F00
"""Where tactels are described in the DCF of a module: the end of the manufacturer's area, which few use."""

HEARTBEAT_MS = 500
"""Of a module, as of the boards that are shipped."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NewBoard:
    """A board to make an EDS of."""

    name: str
    """Of the file."""
    tactels_uv: Floats
    """(n_tactels, 2) m, from the patch centre."""
    pitch: float
    """From one tactel to the next, m."""
    bits: int
    """Of its converter, 8 to 16."""
    full_scale_pa: float = 250_000.0
    canfd: bool = False
    """Whether it sends frames of up to 64 bytes, on CAN FD."""

    def __post_init__(self) -> None:
        uv, n = self.tactels_uv, self.n_tactels
        if not 1 <= n <= MAX_TACTELS:
            raise ValueError(f"{n} tactels; wanted 1 to {MAX_TACTELS}")
        if not 1e-3 <= self.pitch <= 50e-3:
            raise ValueError(f"a pitch of {1e3 * self.pitch:g} mm; wanted 1 to 50")
        if not np.abs(uv).max() <= MOST_M:
            raise ValueError(f"a tactel {np.abs(uv).max():g} m from the centre; wanted at most {MOST_M:g}")
        if not 8 <= self.bits <= 16:
            raise ValueError(f"a converter of {self.bits} bits; wanted 8 to 16")
        if not LEAST_PA <= self.full_scale_pa <= MOST_PA:
            raise ValueError(f"a full scale of {self.full_scale_pa / 1e3:g} kPa; wanted 1 to 100000")

    @property
    def n_tactels(self) -> int:
        """Number of tactels."""
        return len(self.tactels_uv)

    @property
    def reading_bits(self) -> int:
        """Bits of a reading: 16, or 8 where the converter has no more or the TPDOs have no room."""
        is_wide = self.bits > 8 and self.n_tactels * 2 <= len(BASES) * CLASSIC_BYTES
        return 16 if self.canfd or is_wide else 8

    @property
    def mapped(self) -> list[list[int]]:
        """Entries that each TPDO maps."""
        index = cia.READ_ANALOGUE_16 if self.reading_bits == 16 else cia.READ_ANALOGUE_8
        readings = [index << 16 | k << 8 | self.reading_bits for k in range(1, self.n_tactels + 1)]
        most_bits, stamps = (8 * MAX_BYTES, SAMPLING) if self.canfd else (8 * CLASSIC_BYTES, SAMPLING[::-1])
        most = (most_bits - 16 * self.canfd) // self.reading_bits
        mapped = [readings[k : k + most] for k in range(0, len(readings), most)]
        for entries in mapped:
            room = most_bits - len(entries) * self.reading_bits
            for stamp in stamps:
                if (bits := stamp & 0xFF) <= room:
                    entries.append(stamp)
                    room -= bits
        return mapped

    def text(self) -> str:
        """Return the EDS."""
        return self.eds().text()

    def eds(self) -> EdsText:
        """Return the EDS by sections."""
        source = (
            "skin-patch-fd" if self.canfd else {16: "skin-patch", 8: "skin-patch-8bit"}[self.reading_bits]
        )
        eds = EdsText(find_eds(source).read_text("utf-8"))
        n, mapped, uv_um, pitch_um = self.n_tactels, self.mapped, 1e6 * self.tactels_uv, 1e6 * self.pitch
        last, beyond = f"sub{N_SHIPPED:x}", f"sub{N_SHIPPED + 1:x}"
        for name in [s.removesuffix(last) for s in eds.sections if s.endswith(last)]:
            if f"{name}{beyond}" not in eds.sections:
                _resize(eds, name, n)
        _resize(eds, "1a00", most := max(CLASSIC_BYTES, *map(len, mapped)))
        eds.put("1a00sub0", "HighLimit", most)
        first = {name: lines for name, lines in eds.sections.items() if re.match("1[8a]00", name)}
        for name in [s for s in eds.sections if re.match("1[8a]0[0-7]", s)]:
            del eds.sections[name]
        for number, entries in enumerate(mapped):
            for name, lines in first.items():
                made = "\n".join(lines).replace("TPDO 1 ", f"TPDO {number + 1} ")
                made = re.sub(r"\[(1[8A])00", rf"[\g<1>{number:02X}", made)
                eds.sections[f"{name[:2]}{number:02x}{name[4:]}"] = made.split("\n")
            eds.put(f"18{number:02X}sub1", "DefaultValue", f"$NODEID+0x{0x40000000 + BASES[number]:08X}")
            eds.put(f"1A{number:02X}sub0", "DefaultValue", len(entries))
            for sub, entry in enumerate(entries, 1):
                eds.put(f"1A{number:02X}sub{sub:X}", "DefaultValue", f"0x{entry:08X}")
        guard_base = BASES[-1] if len(mapped) < len(BASES) else GUARD_BASE
        eds.put("1808sub1", "DefaultValue", f"$NODEID+0x{0xC0000000 + guard_base:08X}")
        title = f"skin patch of {n} tactels, " + ("CAN FD" if self.canfd else f"{self.reading_bits} bit")
        width, height = 2.0 * np.abs(uv_um).max(0) + pitch_um + ROOM_UM
        del eds.sections["comments"]
        values: dict[str, object] = {
            "2000sub1": n,
            "2000sub2": round(width),
            "2000sub3": round(height),
            "2000sub4": round(max(pitch_um - ROOM_UM, 0.5 * pitch_um)),
            **{f"200{1 + axis}sub{k + 1:X}": round(um) for (k, axis), um in np.ndenumerate(uv_um)},
            "2010sub1": round(self.full_scale_pa),
            "2010sub2": self.bits,
            "2040": f"0x{(1 << n) - 1:016X}",
            "1008": title,
            "1018sub2": f"0x{PRODUCT:08X}",
            "FileInfo FileName": self.name,
            "FileInfo Description": title,
            "DeviceInfo ProductName": title,
            "DeviceInfo ProductNumber": f"0x{PRODUCT:08X}",
            "DeviceInfo OrderCode": f"SP-{n}-{'FD' if self.canfd else self.reading_bits}",
            "DeviceInfo NrOfTXPDO": len(mapped) + 1,
        }
        for place, value in values.items():
            section, _, key = place.partition(" ")
            eds.put(section, key or "DefaultValue", value)
        objects = [s.upper() for s in eds.sections if re.fullmatch("[16][0-9a-f]{3}", s)]
        eds.list_objects("OptionalObjects", [s for s in objects if s not in ("1000", "1001", "1018")])
        return eds


def _resize(eds: EdsText, name: str, n: int) -> None:
    """Give an array n elements; each is as its first but for the number in its name and, mapped, nothing."""
    first = "\n".join(eds.sections[f"{name}sub1"])
    for section in [s for s in eds.sections if re.fullmatch(f"{name}sub(?!0$).*", s)]:
        del eds.sections[section]
    eds.put(name, "SubNumber", n + 1)
    eds.put(f"{name}sub0", "DefaultValue", n)
    for k in range(1, n + 1):
        made = re.sub(r"(?m)^(ParameterName=.*)\b1$", rf"\g<1>{k}", first.replace("sub1]", f"sub{k:X}]"))
        eds.sections[f"{name}sub{k:x}"] = made.split("\n")


def module_dcf(text: str, board: NewBoard, *, name: str = "EDS") -> str:
    """Return the text of a DCF that makes a board of a module; ``text`` is that of its EDS.

    Raises:
        EdsError: the file has faults, or it does not send one reading for each tactel.
    """
    file = read_text(text, name=name)
    carriers = [pdo for pdo in tpdos(build_od(file, 1)) if carries_readings(pdo)]
    sent = sorted(entry.sub for pdo in carriers for entry in readings_in(pdo))
    if sent != list(range(1, board.n_tactels + 1)):
        wanted = f"readings 1 to {board.n_tactels}, one for each tactel"
        file.faults.add("TPDOs", f"readings {sent}", wanted)
    if file.faults:
        raise EdsError(name, file.faults)
    values = {(cia.HEARTBEAT_PRODUCER, 0): HEARTBEAT_MS}
    for pdo in carriers:
        index = cia.TPDO_COMMUNICATION + pdo.number - 1
        values |= {(index, cia.PDO_TYPE): 1, (index, cia.PDO_INHIBIT): 0, (index, cia.PDO_EVENT_TIMER): 0}
    values = {place: value for place, value in values.items() if file.variable(*place) is not None}
    eds = EdsText(dcf_text(text, values, name=name, file_name=board.name))
    for section, lines in board.eds().sections.items():
        if re.match("20[0-4]", section):
            place_of = f"{PLACE + int(section[:4], 16) - 0x2000:04X}"
            body = [re.sub("^AccessType=.*", "AccessType=const", line) for line in lines[1:]]
            eds.sections[f"{place_of}{section[4:]}".lower()] = [f"[{place_of}{section[4:]}]", *body]
    objects = [n.upper() for n in eds.sections if re.fullmatch("[2-5][0-9a-f]{3}", n)]
    eds.list_objects("ManufacturerObjects", objects)
    return eds.text()
