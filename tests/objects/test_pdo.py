"""PDO maps: our files, and any mapping whatsoever against a reader of single bits."""

import pytest

from skinbus.objects.cia import restricted
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import Direction, compile_pdo, tpdos


@pytest.mark.slow
def test_identifiers_of_126_patches_and_the_master_never_meet():
    for eds in ("skin-patch", "skin-patch-8bit", "skin-patch-8x8", "skin-patch-fd"):
        ids = [pdo.cob_id for node_id in range(1, 127) for pdo in tpdos(load_eds(eds, node_id))]
        ids += [pdo.cob_id for pdo in tpdos(load_eds("skin-master", 127))]
        ids = [cob_id for cob_id in ids if not restricted(cob_id)]  # on these no device takes a PDO
        assert len(ids) == len(set(ids))


def test_values_of_the_running_device_win_over_the_file():
    now = {(0x1800, 1): 0x80000000 | 0x321, (0x1800, 2): 255, (0x1A00, 0): 1, (0x1A00, 1): 0x64010210}
    pdo = compile_pdo(load_eds("skin-patch", 5), Direction.TPDO, 1, lambda i, s: now.get((i, s), 0))
    assert (pdo.cob_id, pdo.valid, pdo.transmission_type, pdo.length) == (0x321, False, 255, 2)
    assert pdo.entries[0].sub == 2
