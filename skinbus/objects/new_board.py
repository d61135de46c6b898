"""The EDS of a new board: one of the shipped ones with another grid of tactels, as text.

All that depends on the tactels is made anew: readings, triggers, positions, gains and the like, and the TPDOs
that carry the readings. Their identifiers are those of TPDO 1 to 4 of the predefined connection set, then
those that it gives to RPDO 1 to 4, which a board leaves off: no two boards clash, whatever their node-IDs
(CiA 301, 7.3.5).
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Final

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.model.patch import MAX_TACTELS, grid
from skinbus.objects import cia
from skinbus.objects.eds import find_eds

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

_SECTION: Final = re.compile(r"^\[(\w+)\]$", re.MULTILINE)
_MEMBER: Final = re.compile(r"([0-9A-F]{4})(?:sub([0-9A-F]+))?")


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
        source = find_eds("skin-patch" if self.reading_bits == 16 else "skin-patch-8bit").read_text("utf-8")
        return _Text(source).board(self)


class _Text:
    """The sections of an EDS, changed one after the other."""

    def __init__(self, text: str) -> None:
        names = _SECTION.findall(text)
        bodies = _SECTION.split(text)[2::2]
        self._sections = {name: body.strip() for name, body in zip(names, bodies, strict=True)}

    def board(self, board: NewBoard) -> str:
        """Return the text of a board."""
        n, bits = board.n_tactels, board.reading_bits
        title = f"{board.columns} x {board.rows}, {bits} bit"
        self._tactels(n)
        self._tpdos(board)
        width, height = (round(1000 * (board.pitch_mm * k + ROOM_MM)) for k in (board.columns, board.rows))
        u, v = (1e6 * grid(board.columns, board.rows, 1e-3 * board.pitch_mm)).round().astype(int).T.tolist()
        for k in range(n):
            self._put(f"2001sub{k + 1:X}", u[k])
            self._put(f"2002sub{k + 1:X}", v[k])
        for section, value in {
            "2000sub1": n,
            "2000sub2": width,
            "2000sub3": height,
            "2000sub4": round(1000 * max(board.pitch_mm - ROOM_MM, 0.5 * board.pitch_mm)),
            "2010sub1": round(board.full_scale_pa),
            "2010sub2": board.bits,
            "2040": f"0x{(1 << n) - 1:016X}",
            "1008": f"skin patch {title}",
            "1018sub2": f"0x{PRODUCT:08X}",
        }.items():
            self._put(section, value)
        for key, value in {
            "FileName": board.name,
            "Description": f"skin patch {title}",
        }.items():
            self._put("FileInfo", value, key)
        for key, value in {
            "ProductName": f"skin patch {title}",
            "ProductNumber": f"0x{PRODUCT:08X}",
            "OrderCode": f"SP-{board.columns}{board.rows}-{bits}",
            "NrOfTXPDO": board.n_tpdos,
        }.items():
            self._put("DeviceInfo", value, key)
        self._sections["Comments"] = "\n".join(
            (
                "Lines=4",
                f"Line1=Tactile patch, {board.columns} x {board.rows} tactels at {board.pitch_mm:g} mm; "
                f"readings of {bits} bits in TPDO 1-{board.n_tpdos}.",
                f"Line2=Readings are left-adjusted: full scale is 0x{(1 << bits - 1) - 1:X}.",
                "Line3=Contact law, noise and thresholds are those of another cover until it is calibrated.",
                "Line4=Vendor-ID and product code are not assigned: replace them by yours.",
            )
        )
        self._decimals()
        self._list()
        return "".join(f"[{name}]\n{body}\n\n" for name, body in self._sections.items()).rstrip() + "\n"

    def _put(self, section: str, value: object, key: str = "DefaultValue") -> None:
        pattern = re.compile(rf"^{key}=.*$", re.MULTILINE)
        self._sections[section] = pattern.sub(f"{key}={value}", self._sections[section])

    def _tactels(self, n: int) -> None:
        """Give all arrays by tactel n elements; each is as its first but for the number in its name."""
        length = int(re.findall(r"DefaultValue=(\d+)", self._sections["2001sub0"])[0])
        arrays = [
            name
            for name in self._sections
            if _MEMBER.fullmatch(name)
            and self._sections.get(f"{name}sub0", "").count(f"DefaultValue={length}\n")
            and f"{name}sub{length:X}" in self._sections
            and (name >= "6" or name in ("2001", "2002", "2011", "2012", "2013", "2014", "2031"))
        ]
        for name in arrays:
            self._put(name, n + 1, "SubNumber")
            self._put(f"{name}sub0", n)
            first = self._sections[f"{name}sub1"]
            for k in range(1, max(n, length) + 1):
                self._sections.pop(f"{name}sub{k:X}", None)
            members = {
                f"{name}sub{k:X}": re.sub(r"(?m)^(ParameterName=.*)\b1$", rf"\g<1>{k}", first)
                for k in range(1, n + 1)
            }
            self._insert(f"{name}sub0", members)

    def _tpdos(self, board: NewBoard) -> None:
        """Write the TPDOs, and what each maps."""
        templates = {
            index: {name: body for name, body in self._sections.items() if name.startswith(index)}
            for index in ("1800", "1A00")
        }
        for name in [name for name in self._sections if re.fullmatch(r"1[8A]0\d(sub\w+)?", name)]:
            if name[:4] not in templates:
                del self._sections[name]
        per_frame = 8 * CLASSIC_BYTES // board.reading_bits
        for first, template in templates.items():
            last = list(template)[-1]
            for number in range(board.n_tpdos):
                index = f"{int(first, 16) + number:04X}"
                made = {
                    name.replace(first, index, 1): body.replace("TPDO 1 ", f"TPDO {number + 1} ")
                    for name, body in template.items()
                }
                if number:
                    self._insert(last, made)
                last = list(made)[-1]
        for number in range(board.n_tpdos):
            self._put(f"{0x1800 + number:04X}sub1", f"$NODEID+0x{0x40000000 + BASES[number]:08X}")
            mapped = range(per_frame * number, min(per_frame * (number + 1), board.n_tactels))
            self._put(f"{0x1A00 + number:04X}sub0", len(mapped))
            for place in range(8):
                entry = 0
                if place < len(mapped):
                    entry = READINGS[board.reading_bits] << 16 | mapped[place] + 1 << 8 | board.reading_bits
                self._put(f"{0x1A00 + number:04X}sub{place + 1:X}", f"0x{entry:08X}")

    def _insert(self, after: str, made: dict[str, str]) -> None:
        """Put sections behind another."""
        items = list(self._sections.items())
        at = [name for name, _ in items].index(after) + 1
        self._sections = dict(items[:at]) | made | dict(items[at:])

    def _decimals(self) -> None:
        """Write numbers with a fraction as such, not as the bits that hold them."""
        for name, body in self._sections.items():
            if "DataType=0x0008" in body:
                for spelled in re.findall(r"^DefaultValue=(0x[0-9A-Fa-f]{8})$", body, re.MULTILINE):
                    (value,) = struct.unpack("<f", int(spelled, 16).to_bytes(4, "little"))
                    self._put(name, f"{value:.9g}" if value % 1 else f"{value:.1f}")

    def _list(self) -> None:
        """List the optional objects anew."""
        objects = [
            name
            for name in self._sections
            if re.fullmatch("[16][0-9A-F]{3}", name) and name not in ("1000", "1001", "1018")
        ]
        lines = [f"SupportedObjects={len(objects)}", *(f"{k}=0x{name}" for k, name in enumerate(objects, 1))]
        self._sections["OptionalObjects"] = "\n".join(lines)
