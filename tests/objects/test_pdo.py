"""PDO maps: our files, and any mapping whatsoever against a reader of single bits."""

import pytest

from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import Direction, compile_pdo, tpdos


def test_patch_sends_sixteen_readings_in_four_tpdos():
    maps = tpdos(load_eds("skin-patch", 5))
    assert [pdo.cob_id for pdo in maps] == [0x185, 0x285, 0x385, 0x485]
    assert [pdo.number for pdo in maps] == [1, 2, 3, 4]
    assert all(pdo.valid and not pdo.extended for pdo in maps)
    assert all(pdo.transmission_type == 1 and pdo.length == 8 for pdo in maps)
    entries = [entry for pdo in maps for entry in pdo.entries]
    assert [entry.sub for entry in entries] == list(range(1, 17))
    assert {entry.index for entry in entries} == {cia.READ_ANALOGUE_16}
    assert [entry.offset for entry in maps[2].entries] == [0, 16, 32, 48]
    assert all(entry.signed and entry.bits == 16 for entry in entries)


def test_command_rpdo_is_off_as_delivered():
    pdo = compile_pdo(load_eds("skin-patch", 5), Direction.RPDO, 1)
    assert (pdo.valid, pdo.cob_id, pdo.length) == (False, 0x205, 4)


def test_master_sends_summary_and_sixteen_contacts_and_all_else_if_asked():
    pdos = tpdos(load_eds("skin-master", 127))
    maps, off = pdos[:17], pdos[17:]
    assert [pdo.valid for pdo in pdos] == [True] * 17 + [False] * 19
    assert [pdo.cob_id for pdo in off] == [0x691, 0x692, 0x693, *range(0x6A1, 0x6B1)]
    assert [pdo.length for pdo in off] == [8, 8, 8, *[5] * 16]
    assert [pdo.cob_id for pdo in maps] == [0x1FF, *range(0x681, 0x691)]
    assert {pdo.length for pdo in maps} == {8}
    assert {pdo.transmission_type for pdo in maps} == {254}


@pytest.mark.slow
def test_identifiers_of_126_patches_and_the_master_never_meet():
    for eds in ("skin-patch", "skin-patch-8bit", "skin-patch-8x8", "skin-patch-fd"):
        ids = [pdo.cob_id for node_id in range(1, 127) for pdo in tpdos(load_eds(eds, node_id))]
        ids += [pdo.cob_id for pdo in tpdos(load_eds("skin-master", 127))]
        assert len(ids) == len(set(ids))


def test_values_of_the_running_device_win_over_the_file():
    now = {(0x1800, 1): 0x80000000 | 0x321, (0x1800, 2): 255, (0x1A00, 0): 1, (0x1A00, 1): 0x64010210}
    pdo = compile_pdo(load_eds("skin-patch", 5), Direction.TPDO, 1, lambda i, s: now.get((i, s), 0))
    assert (pdo.cob_id, pdo.valid, pdo.transmission_type, pdo.length) == (0x321, False, 255, 2)
    assert pdo.entries[0].sub == 2


# objects of every length that can be mapped, and dummies of the same lengths
