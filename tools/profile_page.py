"""Make docs/profile.md, what a patch and a master have and must do: `python -m tools.profile_page`."""

from __future__ import annotations

from collections.abc import Collection
from itertools import groupby
from pathlib import Path
from typing import Final

from skinbus.master.commissioning.patch_check import RULES
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

ONLY_STORED: Final = " Only with `--store`: stored parameters are lost."
HEAD: Final = """\
# Profile: what a patch and a master have, and what firmware must do

Made from the EDS files by `python -m tools.profile_page`; a test holds it to them.

## What the firmware of a patch must do

* **Sample on SYNC.** All readings are sampled when SYNC arrives, not before, and sent at once: the last
  TPDO starts within 5 ms of SYNC. A master with `rate_hz = 50` closes its cycle 18 ms after SYNC; what
  comes later is dropped and counted.
* **Discard what is late.** A synchronous TPDO that is not sent within 0x1007 (us, 0: no limit) after its
  SYNC is discarded, also in the transmit buffers of the controller: a classic PDO does not say of which
  SYNC it is, and would be taken for the next one. EMCY 0x8100 with data 07 10 may report it.
* **Left-adjust readings.** Full scale is 0x7FFF in 0x6401 (INTEGER16) and 0x7F in 0x6400 (INTEGER8) for
  every converter; the bits it does not have are 0 (CiA 401).
* **Send raw readings.** The master applies zeros and gains. A board must not take its own zero, at its start
  or by a high-pass filter: this would end a contact that is still held.
* **Be settled before the first TPDO.** Readings of a converter that is warming up are not sent, or are
  marked "unsettled".
* **Send every reading** in an enabled TPDO, or clear the bit of its tactel in "Healthy tactels". An arm
  file with another board is refused.
* **Stamp the frames** where there is room (CAN FD): 0x2070:01 is the counter of the SYNC that the sample
  was taken for, 0 if it had none; 0x2070:02 has bit 0 set when nobody knows when it was sampled, bit 1
  while the converter has not settled, bit 2 while the error register is not 0; 0x2070:03 is the time from
  sampling to SYNC in 100 us, 0xFFFF for that or more. A board that samples by its own clock maps the age.
* **Guard** in OPERATIONAL once 0x2081 holds limits (`skinbus/objects/guard.py` says its bytes; none after a
  reset): compare each sample, one every 0x2080:04 us. A trip sends 0x001 without data before all else, from
  a transmit buffer of its own, then EMCY 0xFF02 with tactel U8 (0: the sum) and its reading I32; once, until
  "ackn" is written to 0x2080:03. 0x2080:01 has bit 0 set (armed) while the newest sample is at most three
  periods old and all guarded tactels are healthy, bit 1 after a trip. TPDO 9 sends it by its timer, and at
  once when it changes.
* **Store** with the signature "save" (0x1010): sub-index 2 stores 0x1xxx, 3 stores 0x6xxx, 4 stores 0x2xxx,
  1 stores all. LSS stores the node-ID. Answer when it is stored; the master waits for `store_timeout_ms`
  (5 s). "load" (0x1011) restores the defaults with the next reset.
* **Clear 0x1020** when any other parameter is changed: the master then configures the board again.
* **Take programs**, if 0x1F50, 0x1F51, 0x1F56 and 0x1F57 are in the EDS: `skinbus board flash` writes 0 and
  3 to 0x1F51:01, an image (`skinbus/objects/program_image.py` says its bytes) to 0x1F50:01, and 1 to
  0x1F51:01, which restarts. 0x1F51:01 is 0x80 until the new program was OPERATIONAL; otherwise the next
  start runs the old one. 0x1F56:01 is the CRC-32 of the image, 0x1F57:01 is 0 when flash is ready,
  and 1 while the board erases or writes beside its answers: that is waited for, up to 10 s.
* **Report errors** as EMCY, once each, and their end as EMCY 0x0000; keep 0x1001 and 0x1003 in step.
* **Be alive**: heartbeat of 0x1017, or node guarding (0x100C, 0x100D) when that is 0.

## Checklist

`skinbus board check -c can0 --node 5` goes through it on a real board and prints pass or FAIL for
each rule.

"""


def page() -> str:
    """Return the page."""
    rules = [
        f"| {rule.name} | {rule.text}{ONLY_STORED * rule.is_destructive} "
        f"| {'' if rule.section == 'skinbus' else 'CiA '}{rule.section.replace(' ', ', ')} |"
        for rule in RULES
    ]
    head = HEAD + "\n".join(["| rule | what is checked | source |", "|---|---|---|", *rules])
    others = ["## Other boards", "Only what differs from `skin-patch` is listed."]
    common = {*_rows(PATCH)}
    for name in OTHERS:
        others += objects_of(name, "###", common)
    return "\n\n".join([head, *objects_of(PATCH), *others, *objects_of(MASTER)]) + "\n"


def objects_of(name: str, level: str = "##", known: Collection[str] = ()) -> list[str]:
    """Return the part of the page on the objects of one EDS, but for known rows of the table."""
    section = read_eds(name).section("Comments")
    comment = " ".join(text for key, text in section.keys.items() if key != "lines") if section else ""
    rows = [row for row in _rows(name) if row not in known]
    head = ["| index | object | type | access | default | limits | PDO |", "|---|---|---|---|---|---|---|"]
    return [f"{level} {Path(name).stem}", *([comment] if comment else []), "\n".join([*head, *rows])]


def _rows(name: str) -> list[str]:
    """Return the table of a file; neighbours that differ in nothing but number are one row."""
    rows = []
    for _, entry in sorted(read_eds(name).objects.items()):
        members = [variable for sub, variable in sorted(entry.variables.items()) if sub or not entry.is_group]
        for key, group in groupby(members, _likeness):
            same = list(group)
            first, values = same[0], {_value(variable) for variable in same}
            is_sub = first.generated or "sub" in first.section.lower()
            sub = f":{first.sub:02X}" if is_sub else ""
            title = first.name
            if len(same) > 1:
                title, sub = key[0], f"{sub}-{same[-1].sub:02X}"
            value = values.pop() if len(values) == 1 else "..."
            cells = [f"0x{first.index:04X}{sub}", title, *key[1:3], value, *key[3:5]]
            rows.append(f"| {' | '.join(cells)} |")
    return rows


def _likeness(variable: Variable) -> tuple[str, ...]:
    """Return name without number, type, access, limits, whether it may be mapped, and what it maps."""
    low, high = ("" if limit is None else f"{limit:g}" for limit in (variable.low, variable.high))
    return (
        variable.name.rstrip("0123456789").rstrip(),
        TYPES[variable.data_type].name,
        variable.access,
        f"{low}..{high}" if low or high else "",
        "yes" if variable.mappable else "",
        _value(variable) if variable.index in MAPPINGS else "",
    )


def _value(variable: Variable) -> str:
    value = variable.current
    if value is None:
        return ""
    number = value.number
    if not isinstance(number, int):
        return f"{number:g}" if isinstance(number, float) else str(number)
    if value.relative:
        return f"node-ID + 0x{number:X}"
    is_code = number and variable.index in COMMUNICATION and variable.data_type == UNSIGNED32
    return f"0x{number:X}" if is_code or number > 0xFFFF else str(number)


if __name__ == "__main__":
    Path("docs/profile.md").write_text(page())
