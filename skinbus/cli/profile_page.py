"""The profile page: what a patch and a master have and must do, as Markdown made from EDS files and rules."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

from skinbus.master.commissioning.patch_check import RULES, Rule
from skinbus.objects import cia
from skinbus.objects.eds import read_eds
from skinbus.objects.eds_file import Variable
from skinbus.objects.eds_values import TYPES, UNSIGNED32

PATCH: Final = "skin-patch"
OTHERS: Final = ("skin-patch-8bit", "skin-patch-8x8", "skin-patch-fd", "skin-patch-fd32")
MASTER: Final = "skin-master"

COMMUNICATION: Final = range(0x1000, 0x2000)
MAPPINGS: Final = range(cia.RPDO_MAPPING, cia.TPDO_MAPPING + cia.MAX_PDOS)
"""Objects of which every value is shown."""

HEAD: Final = """\
# Profile: what a patch and a master have, and what firmware must do

Made from the EDS files by `skinbus board profile --out docs/profile.md`; a test holds it to them. `skinbus
board profile MY.eds` makes the table of objects of a board of your own.

## What the firmware of a patch must do

* **Sample on SYNC.** All readings are sampled when SYNC arrives, not before, and sent at once: the last
  TPDO starts within 5 ms of SYNC. A master with `rate_hz = 50` closes its cycle 18 ms after SYNC; what
  comes later is dropped and counted.
* **Discard what is late.** A synchronous TPDO that is not sent within 0x1007 (us, 0: no limit) after its
  SYNC is discarded, also in the transmit buffers of the controller: a classic PDO does not say of which
  SYNC it is, and would be taken for the next one. EMCY 0x8100 with data 07 10 may report it.
* **Left-adjust readings.** Full scale is 0x7FFF in 0x6401 (INTEGER16) and 0x7F in 0x6400 (INTEGER8),
  whatever the converter has; bits that it does not have are 0 (CiA 401). Readings are raw: the master
  takes zeros and gains off itself. A board that takes its own zero, when it starts or slowly by a high-pass
  filter, under a finger ends that contact although it is held; it shows when the finger is gone.
* **Be settled before the first TPDO.** Readings of a converter that is warming up are not sent, or are
  marked "unsettled".
* **Send every reading** in an enabled TPDO, or clear the bit of its tactel in "Healthy tactels": an arm
  file with a board that does not is refused.
* **Stamp the frames** where there is room (CAN FD): 0x2070:01 is the counter of the SYNC that the sample
  was taken for, 0 if it had none; 0x2070:02 has bit 0 set when the sample is older than the SYNC, bit 1
  while the converter has not settled, bit 2 while the error register is not 0.
* **Store** with the signature "save" (0x1010): what is 0x1xxx by sub-index 2, 0x6xxx by 3, 0x2xxx by 4,
  all by 1, and the node-ID by LSS. Answer when it is stored; `store_timeout_ms` (5 s) is how long the
  master waits. "load" (0x1011) brings the defaults back with the next reset.
* **Clear 0x1020** when any other parameter is changed: the master then configures the board again.
* **Report errors** as EMCY, once each, and their end as EMCY 0x0000; keep 0x1001 and 0x1003 in step.
* **Be alive**: heartbeat of 0x1017, or node guarding (0x100C, 0x100D) when that is 0.

## Checklist

`skinbus board check --channel can0 --node 5` goes through it on a real board and prints pass or FAIL for
each rule.

"""


def page() -> str:
    """Return the page."""
    parts = [HEAD + "\n".join(checklist(RULES)), *objects_of(PATCH)]
    parts += ["## Other boards", "Only what differs from `skin-patch` is listed."]
    common = {_row(group) for group in _rows(PATCH)}
    for name in OTHERS:
        rows = [row for row in map(_row, _rows(name)) if row not in common]
        parts += [f"### {name}", *_comment(name), _table(rows)]
    parts += objects_of(MASTER)
    return "\n\n".join(parts) + "\n"


def checklist(rules: Sequence[Rule]) -> Iterator[str]:
    """Return the lines of the table of rules."""
    yield "| rule | what is checked | source |"
    yield "|---|---|---|"
    for rule in rules:
        only = " Only with `--store`: stored parameters are lost." if rule.is_destructive else ""
        source = rule.section if rule.section == "skinbus" else f"CiA {rule.section.replace(' ', ', ')}"
        yield f"| {rule.name} | {rule.text}{only} | {source} |"


def objects_of(name: str) -> list[str]:
    """Return the part of the page on all objects of one EDS."""
    return [f"## {Path(name).stem}", *_comment(name), _table([_row(group) for group in _rows(name)])]


def _comment(name: str) -> list[str]:
    section = read_eds(name).section("Comments")
    lines = [text for key, text in section.keys.items() if key != "lines"] if section else []
    return [" ".join(lines)] if lines else []


def _rows(name: str) -> list[list[Variable]]:
    """Return the variables of a file in groups: neighbours that differ in nothing but number are one row."""
    rows: list[list[Variable]] = []
    for _, entry in sorted(read_eds(name).objects.items()):
        members = [variable for sub, variable in sorted(entry.variables.items()) if sub or not entry.is_group]
        rows += [list(group) for _, group in groupby(members, key=_likeness)]
    return rows


def _likeness(variable: Variable) -> tuple[object, ...]:
    name = variable.name.rstrip("0123456789").rstrip()
    mapping = _value(variable) if variable.index in MAPPINGS else ""
    return (
        variable.index,
        name,
        variable.data_type,
        variable.access,
        variable.mappable,
        _limits(variable),
        mapping,
    )


def _row(group: list[Variable]) -> str:
    first, last = group[0], group[-1]
    sub = "" if first.section.lower().find("sub") < 0 and not first.generated else f":{first.sub:02X}"
    if len(group) > 1:
        sub += f"-{last.sub:02X}"
    name = first.name if len(group) == 1 else first.name.rstrip("0123456789").rstrip()
    values = {_value(variable) for variable in group}
    value = values.pop() if len(values) == 1 else "..."
    kind = TYPES[first.data_type].name
    mapped = "yes" if first.mappable else ""
    cells = [f"0x{first.index:04X}{sub}", name, kind, first.access, value, _limits(first), mapped]
    return f"| {' | '.join(cells)} |"


def _value(variable: Variable) -> str:
    value = variable.current
    if value is None:
        return ""
    number = value.number
    if isinstance(number, int) and not value.relative:
        is_code = variable.index in COMMUNICATION and variable.data_type == UNSIGNED32
        return f"0x{number:X}" if number > 0xFFFF or (is_code and number) else str(number)
    if value.relative and isinstance(number, int):
        return f"node-ID + 0x{number:X}"
    return f"{number:g}" if isinstance(number, float) else str(number)


def _limits(variable: Variable) -> str:
    if variable.low is None and variable.high is None:
        return ""
    low = "" if variable.low is None else f"{variable.low:g}"
    high = "" if variable.high is None else f"{variable.high:g}"
    return f"{low}..{high}"


def _table(rows: Sequence[str]) -> str:
    return "\n".join(
        [
            "| index | object | type | access | default | limits | PDO |",
            "|---|---|---|---|---|---|---|",
            *rows,
        ]
    )
