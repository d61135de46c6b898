"""Which TPDO of the master carries what."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from canopen.objectdictionary import ObjectDictionary

from skinbus.objects import profile
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import PdoMap, tpdos

SUMMARY, FIRST_CONTACT, LOAD, FIRST_QUALITY = 1, 2, 18, 21
"""Numbers of TPDOs in skin-master.eds."""


class Published(NamedTuple):
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


@cache
def master_od(node_id: int = profile.MASTER_NODE_ID) -> ObjectDictionary:
    """Return the dictionary of a master, which all share: it is only read."""
    return load_eds("skin-master", node_id)


@cache
def master_tpdos() -> list[PdoMap]:
    """Return all TPDOs of a master with the usual node-ID, as its EDS has them."""
    return tpdos(master_od())


@cache
def usual(node_id: int = profile.MASTER_NODE_ID) -> Published:
    """Return the TPDOs of a master as its EDS has them, with the usual node-ID or another."""
    pdos = {pdo.number: pdo for pdo in tpdos(master_od(node_id))}
    contacts = tuple(pdos[FIRST_CONTACT + slot] for slot in range(profile.MAX_CONTACTS))
    return Published(pdos[SUMMARY], contacts, pdos[LOAD])
