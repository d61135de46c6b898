"""PDO maps: our files, and any mapping whatsoever against a reader of single bits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.objects import cia
from skinbus.objects.eds import build_od, load_eds
from skinbus.objects.eds_file import read_text
from skinbus.objects.pdo import Direction, compile_pdo, rpdos, tpdos
from tests.objects.inverse import join_mapping


def test_patch_sends_sixteen_readings_in_four_tpdos():
    maps = tpdos(load_eds("skin-patch", 5))
    assert [pdo.cob_id for pdo in maps] == [0x185, 0x285, 0x385, 0x485]
    assert [pdo.number for pdo in maps] == [1, 2, 3, 4]
    assert all(pdo.valid and not pdo.rtr_allowed and not pdo.extended for pdo in maps)
    assert all(pdo.transmission_type == 1 and pdo.length == 8 for pdo in maps)
    entries = [entry for pdo in maps for entry in pdo.entries]
    assert [entry.sub for entry in entries] == list(range(1, 17))
    assert {entry.index for entry in entries} == {cia.READ_ANALOGUE_16}
    assert [entry.offset for entry in maps[2].entries] == [0, 16, 32, 48]
    assert all(entry.signed and entry.bits == 16 for entry in entries)


@pytest.mark.parametrize(("eds", "n", "length"), [("skin-patch-fd", 16, 48), ("skin-patch-fd32", 31, 64)])
def test_patch_for_can_fd_sends_readings_with_their_stamp_in_one_frame(eds, n, length):
    pdo, *others = tpdos(load_eds(eds, 5))
    assert (pdo.cob_id, pdo.length) == (0x185, length)
    assert [(entry.index, entry.sub) for entry in pdo.entries] == [
        *((0x6401, k) for k in range(1, n + 1)),
        (0x2070, 1),
        (0x2070, 2),
    ]
    assert [entry.offset for entry in pdo.entries] == [*range(0, 16 * n, 16), 16 * n, 16 * n + 8]
    for other in others:  # what the longest frame has no room for, with a stamp of its own
        assert [(entry.index, entry.sub) for entry in other.entries] == [
            (0x6401, 32),
            (0x2070, 1),
            (0x2070, 2),
        ]
        assert (other.cob_id, other.length) == (0x285, 4)


def test_command_rpdo_is_off_as_delivered():
    (pdo,) = rpdos(load_eds("skin-patch", 5))
    assert (pdo.valid, pdo.cob_id, pdo.length) == (False, 0x205, 4)


def test_master_sends_summary_and_sixteen_contacts_and_load_and_torques_if_asked():
    *maps, load, first, second = tpdos(load_eds("skin-master", 127))
    assert (load.valid, load.cob_id, load.length) == (False, 0x691, 8)
    assert [(pdo.valid, pdo.cob_id, pdo.length) for pdo in (first, second)] == [
        (False, 0x692, 8),
        (False, 0x693, 8),
    ]
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


def test_missing_pdo_is_a_key_error():
    with pytest.raises(KeyError):
        compile_pdo(load_eds("skin-patch", 5), Direction.TPDO, 5)


# objects of every length that can be mapped, and dummies of the same lengths
LENGTHS = {2: 8, 3: 16, 4: 32, 5: 8, 6: 16, 7: 32, 0x10: 24, 0x15: 64, 0x1B: 64, 1: 1}


FRAME_LENGTHS = [*range(9), 12, 16, 20, 24, 32, 48, 64]


def device(entries):
    """Return an EDS text with one TPDO that maps the given (data type, dummy) pairs."""
    text = ["[DummyUsage]", *(f"Dummy{t:04X}=1" for t in range(1, 8))]
    words = []
    for k, (data_type, dummy) in enumerate(entries, 1):
        words.append(join_mapping(data_type if dummy else 0x2000 + k, 0, LENGTHS[data_type]))
        text += [f"[{0x2000 + k:04X}]", f"ParameterName=O{k}", f"DataType={data_type}"]
        text += ["AccessType=ro", "PDOMapping=1"]
    text += ["[1800]", "ParameterName=C", "ObjectType=9", "[1800sub1]", "ParameterName=I"]
    text += ["DataType=7", "AccessType=rw", "DefaultValue=0x181"]
    text += ["[1A00]", "ParameterName=M", "ObjectType=9", "[1A00sub0]", "ParameterName=N"]
    text += ["DataType=5", "AccessType=rw", f"DefaultValue={len(words)}"]
    for k, word in enumerate(words, 1):
        text += [f"[1A00sub{k:X}]", f"ParameterName=E{k}", "DataType=7", "AccessType=rw"]
        text += [f"DefaultValue=0x{word:08X}"]
    return build_od(read_text("\n".join(text), name="x.eds"), 1)


@given(st.lists(st.tuples(st.sampled_from(sorted(LENGTHS)), st.booleans()), max_size=8))
def test_any_mapping_lies_end_to_end(pairs):
    pairs = [(t, dummy and t < 8) for t, dummy in pairs]
    (pdo,) = tpdos(device(pairs))
    offset = 0
    for (data_type, dummy), entry in zip(pairs, pdo.entries, strict=True):
        assert (entry.offset, entry.bits) == (offset, LENGTHS[data_type])
        assert entry.is_dummy == dummy
        assert entry.signed == (data_type in (2, 3, 4, 0x10, 0x15))
        offset += entry.bits
    assert pdo.length == min(n for n in FRAME_LENGTHS if 8 * n >= offset)
