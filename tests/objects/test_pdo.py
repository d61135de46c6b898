"""PDO maps: our files, and any mapping whatsoever against a reader of single bits."""

import pytest

from skinbus.objects.cia import restricted
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import tpdos


@pytest.mark.slow
def test_identifiers_of_126_patches_and_the_master_never_meet():
    for eds in ("skin-patch", "skin-patch-8bit", "skin-patch-8x8", "skin-patch-fd"):
        first, last = ([pdo.cob_id for pdo in tpdos(load_eds(eds, n))] for n in (1, 126))
        assert last == [cob_id + 125 for cob_id in first]
        ids = [cob_id + n for cob_id in first for n in range(126)]
        ids += [pdo.cob_id for pdo in tpdos(load_eds("skin-master", 127))]
        ids = [cob_id for cob_id in ids if not restricted(cob_id)]  # on these no device takes a PDO
        assert len(ids) == len(set(ids))
