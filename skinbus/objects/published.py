"""Which TPDO of the master carries what: found by what it maps, in the master's object dictionary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from canopen.objectdictionary import ObjectDictionary

from skinbus.objects import profile
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import PdoMap, tpdos

QUALITY = "Quality"
"""Member of a contact record that the TPDO of its quality begins with."""


@dataclass(frozen=True, slots=True)
class Published:
    """The TPDOs of a master."""

    summary: PdoMap
    contacts: tuple[PdoMap, ...]
    """By slot of the contact."""
    qualities: tuple[PdoMap, ...]
    """How sure a contact is, by slot; the EDS has them disabled."""
    load: PdoMap
    """That of the arm; the EDS has it disabled."""

    @property
    def contact_ids(self) -> tuple[int, ...]:
        """COB-IDs of the contacts, by slot."""
        return tuple(pdo.cob_id for pdo in self.contacts)


def published(od: ObjectDictionary) -> Published:
    """Return the TPDOs of a master with this dictionary; ValueError when one is missing."""
    by_first = {(pdo.entries[0].index, pdo.entries[0].sub): pdo for pdo in tpdos(od) if pdo.entries}
    numbers = range(1, profile.MAX_CONTACTS + 1)
    names = [name.partition("/")[0] for name in (profile.CYCLES, profile.LOAD)]
    names += [profile.contact(k, member) for member in ("", QUALITY) for k in numbers]
    first = [(index, sub or 1) for index, sub in (profile.index_of(od, name) for name in names)]
    if missing := [name for name, key in zip(names, first, strict=True) if key not in by_first]:
        raise ValueError(f"no TPDO begins with {', '.join(missing)}")
    summary, load, *rest = (by_first[key] for key in first)
    contacts, qualities = rest[: profile.MAX_CONTACTS], rest[profile.MAX_CONTACTS :]
    return Published(summary, tuple(contacts), tuple(qualities), load)


@cache
def usual(node_id: int = profile.MASTER_NODE_ID) -> Published:
    """Return the TPDOs of a master as its EDS has them, with the usual node-ID or another."""
    return published(load_eds("skin-master", node_id))
