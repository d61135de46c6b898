"""Which TPDO of the master carries what: found by what it maps, in the master's object dictionary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from canopen.objectdictionary import ObjectDictionary

from skinbus.objects import profile
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import PdoMap, tpdos


@dataclass(frozen=True, slots=True)
class Published:
    """The TPDOs of a master."""

    summary: PdoMap
    contacts: tuple[PdoMap, ...]
    """By slot of the contact."""
    load: PdoMap
    """That of the arm; the EDS has it disabled."""

    @property
    def contact_ids(self) -> tuple[int, ...]:
        """COB-IDs of the contacts, by slot."""
        return tuple(pdo.cob_id for pdo in self.contacts)


def published(od: ObjectDictionary) -> Published:
    """Return the TPDOs of a master with this dictionary; ValueError when one is missing."""
    by_object = {pdo.entries[0].index: pdo for pdo in tpdos(od) if pdo.entries}
    contacts_of = [profile.contact(k + 1) for k in range(profile.MAX_CONTACTS)]
    names = [profile.CYCLES, profile.LOAD, *contacts_of]
    missing = [name.object for name in names if od[name.object].index not in by_object]
    if missing:
        raise ValueError(f"no TPDO maps {', '.join(missing)}")
    summary, load, *contacts = (by_object[od[name.object].index] for name in names)
    return Published(summary, tuple(contacts), load)


@cache
def usual(node_id: int = profile.MASTER_NODE_ID) -> Published:
    """Return the TPDOs of a master as its EDS has them, with the usual node-ID or another."""
    return published(load_eds("skin-master", node_id))
