"""The file of a new board: a shipped EDS with another grid of tactels, or the EDS of an analogue module.

All that depends on the tactels is made anew: readings, triggers, positions, gains and the like, and the TPDOs
that carry the readings. Their identifiers are those of TPDO 1 to 4 of the predefined connection set, then
those that it gives to RPDO 1 to 4, which a board leaves off: no two boards clash, whatever their node-IDs
(CiA 301, 7.3.5).

A module of others does not have the objects that describe tactels: in its DCF they are constants that only
the master reads. What the module itself must be set are ParameterValues, which the master downloads: its
readings are sent on each SYNC, and it sends heartbeats.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.errors import EdsError, Fault
from skinbus.model.patch import MAX_TACTELS, grid
from skinbus.objects import cia
from skinbus.objects.dcf import dcf_text
from skinbus.objects.eds import build_od, find_eds
from skinbus.objects.eds_file import read_text
from skinbus.objects.eds_text import EdsText
from skinbus.objects.pdo import carries_readings, readings_in, tpdos

BASES: Final = (*cia.TPDO_BASES, *cia.RPDO_BASES)
"""Identifiers of the TPDOs, less the node-ID."""

LEAST_PA: Final = 1_000
MOST_PA: Final = 100_000_000
"""Full scales from a light touch to a thousand times what a palm presses; as an UNSIGNED32 in the EDS."""

ROOM_MM: Final = 1.0
"""Of a tactel to its neighbour: a sensing cell fills the pitch but for so much."""

READINGS: Final = {16: cia.READ_ANALOGUE_16, 8: cia.READ_ANALOGUE_8}
"""Object of the readings by their bits."""

PRODUCT: Final = 0x6000
"""Product code of a board of others, until its maker gives it one."""

N_SHIPPED: Final = 0x10
"""Tactels of the shipped boards; only arrays by tactel have so many elements."""

PLACE: Final = 0x5F00
"""Where tactels are described in the DCF of a module: the end of the manufacturer's area, which few use."""

HEARTBEAT_MS: Final = 500
"""Of a module, as of the boards that are shipped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewBoard:
    """What is asked of a board."""

    name: str
    """Of the file."""
    rows: int
    columns: int
    pitch_mm: float
    bits: int
    """Of its converter, 8 to 16."""
    full_scale_pa: float = 250_000.0

    def __post_init__(self) -> None:
        if not 1 <= self.rows * self.columns <= MAX_TACTELS:
            raise ValueError(f"{self.rows} x {self.columns} tactels; wanted 1 to {MAX_TACTELS}")
        if not 1.0 <= self.pitch_mm <= 50.0:
            raise ValueError(f"a pitch of {self.pitch_mm:g} mm; wanted 1 to 50")
        if not 8 <= self.bits <= 16:
            raise ValueError(f"a converter of {self.bits} bits; wanted 8 to 16")
        if not LEAST_PA <= self.full_scale_pa <= MOST_PA:
            raise ValueError(f"a full scale of {self.full_scale_pa / 1e3:g} kPa; wanted 1 to 100000")

    @property
    def n_tactels(self) -> int:
        """Number of tactels."""
        return self.rows * self.columns

    @property
    def reading_bits(self) -> int:
        """Bits of a reading: 16, or 8 where the converter has no more or the TPDOs have no room."""
        return 16 if self.bits > 8 and self.n_tactels * 2 <= len(BASES) * CLASSIC_BYTES else 8

    @property
    def n_tpdos(self) -> int:
        """Number of TPDOs."""
        return -(-self.n_tactels // (8 * CLASSIC_BYTES // self.reading_bits))

    def text(self) -> str:
        """Return the EDS."""
        return self.eds().text()

    def eds(self) -> EdsText:
        """Return the EDS by sections."""
        source = find_eds("skin-patch" if self.reading_bits == 16 else "skin-patch-8bit")
        eds = EdsText(source.read_text("utf-8"))
        for name in [n.removesuffix(f"sub{N_SHIPPED:x}") for n in eds.sections]:
            if (
                f"{name}sub{N_SHIPPED:x}" in eds.sections
                and f"{name}sub{N_SHIPPED + 1:x}" not in eds.sections
            ):
                _resize(eds, name, self.n_tactels)
        self._tpdos(eds)
        for axis, column in zip(
            ("2001", "2002"), grid(self.columns, self.rows, self.pitch_mm).T, strict=True
        ):
            for k, mm in enumerate(column, 1):
                eds.put(f"{axis}sub{k:X}", "DefaultValue", round(1000 * mm))
        bits, title = self.reading_bits, f"skin patch {self.columns} x {self.rows}, {self.reading_bits} bit"
        width, height = (round(1000 * (self.pitch_mm * k + ROOM_MM)) for k in (self.columns, self.rows))
        del eds.sections["comments"]
        values = {
            "2000sub1": self.n_tactels,
            "2000sub2": width,
            "2000sub3": height,
            "2000sub4": round(1000 * max(self.pitch_mm - ROOM_MM, 0.5 * self.pitch_mm)),
            "2010sub1": round(self.full_scale_pa),
            "2010sub2": self.bits,
            "2040": f"0x{(1 << self.n_tactels) - 1:016X}",
            "1008": title,
            "1018sub2": f"0x{PRODUCT:08X}",
            "FileInfo FileName": self.name,
            "FileInfo Description": title,
            "DeviceInfo ProductName": title,
            "DeviceInfo ProductNumber": f"0x{PRODUCT:08X}",
            "DeviceInfo OrderCode": f"SP-{self.columns}{self.rows}-{bits}",
            "DeviceInfo NrOfTXPDO": self.n_tpdos,
        }
        for place, value in values.items():
            section, _, key = place.partition(" ")
            eds.put(section, key or "DefaultValue", value)
        objects = [n.upper() for n in eds.sections if re.fullmatch("[16][0-9a-f]{3}", n)]
        eds.list_objects("OptionalObjects", [n for n in objects if n not in ("1000", "1001", "1018")])
        return eds

    def _tpdos(self, eds: EdsText) -> None:
        """Write the TPDOs, each as the first, and what each maps."""
        for name in [n for n in eds.sections if re.match("1[8a]0[1-9]", n)]:
            del eds.sections[name]
        first = {name: lines for name, lines in eds.sections.items() if re.match("1[8a]00", name)}
        per_frame = 8 * CLASSIC_BYTES // self.reading_bits
        for number in range(self.n_tpdos):
            for name, lines in first.items():
                made = "\n".join(lines).replace("TPDO 1 ", f"TPDO {number + 1} ")
                made = re.sub(r"\[(1[8A])00", rf"[\g<1>{number:02X}", made)
                eds.sections[f"{name[:2]}{number:02x}{name[4:]}"] = made.split("\n")
            eds.put(f"18{number:02X}sub1", "DefaultValue", f"$NODEID+0x{0x40000000 + BASES[number]:08X}")
            mapped = range(per_frame * number, min(per_frame * (number + 1), self.n_tactels))
            eds.put(f"1A{number:02X}sub0", "DefaultValue", len(mapped))
            for place in range(8):
                entry = 0
                if place < len(mapped):
                    entry = READINGS[self.reading_bits] << 16 | mapped[place] + 1 << 8 | self.reading_bits
                eds.put(f"1A{number:02X}sub{place + 1:X}", "DefaultValue", f"0x{entry:08X}")


def _resize(eds: EdsText, name: str, n: int) -> None:
    """Give an array n elements; each is as its first but for the number in its name."""
    eds.put(name, "SubNumber", n + 1)
    eds.put(f"{name}sub0", "DefaultValue", n)
    first = "\n".join(eds.sections[f"{name}sub1"])
    for k in range(1, N_SHIPPED + 1):
        del eds.sections[f"{name}sub{k:x}"]
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
        file.faults.append(Fault("TPDOs", f"readings {sent}", wanted))
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
