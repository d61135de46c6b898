"""An analogue module of others as a board: its EDS with the objects that describe tactels, as a DCF.

The module does not have these objects: they are constants that only the master reads. What the module itself
must be set are ParameterValues, which the master downloads: its readings are sent on each SYNC, and it sends
heartbeats. ``0x7130`` of CiA 404 is taken for readings as ``0x6401`` of CiA 401 is.
"""

from __future__ import annotations

import re
from typing import Final

from skinbus.errors import EdsError, Fault
from skinbus.objects import cia
from skinbus.objects.dcf import dcf_text
from skinbus.objects.eds import build_od
from skinbus.objects.eds_file import EdsFile, read_text
from skinbus.objects.eds_values import Number
from skinbus.objects.new_board import NewBoard
from skinbus.objects.pdo import carries_readings, readings_in, tpdos

DESCRIPTION: Final = range(0x2000, 0x2050)
"""Objects of a board of ours that say what its readings mean."""

PLACE: Final = 0x5F00
"""Where they are in the DCF of a module: the end of the manufacturer's area, which few use."""

HEARTBEAT_MS: Final = 500
"""As of the boards that are shipped."""

_SECTION: Final = re.compile(r"^\[(\w+)\][ \t]*$", re.MULTILINE)


def module_dcf(text: str, board: NewBoard, *, name: str = "EDS") -> str:
    """Return the text of a DCF that makes a board of a module; ``text`` is that of its EDS.

    Raises:
        EdsError: the file has faults, its places are taken, or it does not send one reading for each tactel.
    """
    text = "\n".join(text.splitlines()) + "\n"
    file = read_text(text, name=name)
    faults = [*file.faults]
    if faults:
        raise EdsError(name, faults)
    sections = _description(board)
    taken = [index for index in file.objects if PLACE <= index < PLACE + len(DESCRIPTION)]
    faults += [
        Fault(f"0x{index:04X}", "an object", "nothing: tactels are described there") for index in taken
    ]
    values = _settings(file, board.n_tactels, faults)
    if faults:
        raise EdsError(name, faults)
    made = dcf_text(text, values, name=name, file_name=board.name)
    added = [section for section in sections if len(section) == 4]
    listed = [f"0x{index:04X}" for index in file.objects if 0x2000 <= index < 0x6000]
    return _list(made, listed + [f"0x{index}" for index in added]) + "".join(
        f"\n[{section}]\n{body}\n" for section, body in sections.items()
    )


def _description(board: NewBoard) -> dict[str, str]:
    """Return the sections that describe the tactels of a board, at their places in a module's file."""
    parts = _SECTION.split(board.text())
    sections = {}
    for section, body in zip(parts[1::2], parts[2::2], strict=True):
        number = re.match(r"[0-9A-F]{4}", section)
        if number and int(number[0], 16) in DESCRIPTION:
            moved = f"{PLACE + int(number[0], 16) - DESCRIPTION.start:04X}{section[4:]}"
            sections[moved] = re.sub(r"(?m)^AccessType=.*$", "AccessType=const", body.strip())
    return sections


def _settings(file: EdsFile, n_tactels: int, faults: list[Fault]) -> dict[tuple[int, int], Number]:
    """Return what is written to the module; add faults where it is no board of so many tactels."""
    values: dict[tuple[int, int], Number] = {}
    carriers = [pdo for pdo in tpdos(build_od(file, 1)) if carries_readings(pdo)]
    sent = sorted(entry.sub for pdo in carriers for entry in readings_in(pdo))
    if sent != list(range(1, n_tactels + 1)):
        faults.append(Fault("TPDOs", f"readings {sent}", f"readings 1 to {n_tactels}, one for each tactel"))
    for pdo in carriers:
        wanted = {cia.PDO_TYPE: 1, cia.PDO_INHIBIT: 0, cia.PDO_EVENT_TIMER: 0}
        for sub, value in wanted.items():
            variable = file.variable(cia.TPDO_COMMUNICATION + pdo.number - 1, sub)
            if variable is not None:
                values[cia.TPDO_COMMUNICATION + pdo.number - 1, sub] = value
    if file.variable(cia.HEARTBEAT_PRODUCER, 0) is not None:
        values[cia.HEARTBEAT_PRODUCER, 0] = HEARTBEAT_MS
    return values


def _list(text: str, objects: list[str]) -> str:
    """Return a text that lists these as the manufacturer's objects."""
    lines = [f"SupportedObjects={len(objects)}", *(f"{k}={name}" for k, name in enumerate(objects, 1))]
    section = "[ManufacturerObjects]\n" + "\n".join(lines) + "\n\n"
    found = re.search(r"(?mi)^\[ManufacturerObjects\][ \t]*\n(?:[^\[\n].*\n|\n)*", text)
    if found is None:
        return f"{text}\n{section}"
    return text[: found.start()] + section + text[found.end() :]
