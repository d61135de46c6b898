"""EDS loading: our files against the canopen package's reader, node-IDs, values that other readers lose."""

import os

import canopen
import pytest

from skinbus.objects import cia, profile
from skinbus.objects.eds import build_od, eds_names, find_eds, load_eds, read_eds
from skinbus.objects.eds_file import read_text
from skinbus.objects.eds_values import REAL32
from tests.files import put

OURS = [
    "skin-master",
    "skin-patch",
    "skin-patch-8bit",
    "skin-patch-8x8",
    "skin-patch-fd",
    "skin-patch-fd32",
]


def test_shipped_names_are_found():
    assert eds_names() == OURS


@pytest.mark.parametrize("node_id", [0, 128, -1])
def test_node_id_outside_1_to_127_is_refused(node_id):
    with pytest.raises(ValueError, match=r"1\.\.127"):
        load_eds("skin-patch", node_id)


@pytest.mark.parametrize("name", OURS)
def test_dictionary_equals_what_the_canopen_package_reads(name):
    ours, theirs = load_eds(name, 9), canopen.import_od(str(find_eds(name)), 9)
    assert list(ours) == [index for index in theirs if index >= cia.DEVICE_TYPE]
    for index in ours:
        for variable in theirs[index].values() if hasattr(theirs[index], "values") else [theirs[index]]:
            mine = ours.get_variable(variable.index, variable.subindex)
            compact = variable.index in compact_indices(name)
            fields = ["data_type", "access_type", "pdo_mappable", "min", "max", "relative"]
            if not compact:  # that reader gives no default for the count, and other names
                fields.append("name")
            if not compact and variable.data_type != REAL32:  # that reader loses bit patterns
                fields.append("default")
            if compact and variable.subindex == 0:
                fields = ["data_type"]
            for field in fields:
                assert getattr(mine, field) == getattr(variable, field), (variable, field)


def compact_indices(name):
    if name != "skin-master":
        return set()
    return {
        0x1016,
        0x1028,
        *range(0x1F22, 0x1F28),
        *range(0x1F81, 0x1F89),
        *range(0x2300, 0x2307),
        *range(0x2310, 0x2313),
        *range(0x2320, 0x2326),
    }


def test_each_node_gets_its_own_dictionary():
    first, second = load_eds("skin-patch", 1), load_eds("skin-patch", 2)
    assert first[cia.EMCY_COB_ID].default == 0x81
    assert second[cia.EMCY_COB_ID].default == 0x82
    first[0x2030]["Touch Pa"].value = 1
    assert second[0x2030]["Touch Pa"].value is None
    assert load_eds("skin-patch", 1)[0x2030]["Touch Pa"].value is None


def test_changed_file_is_read_again(tmp_path):
    path = put(tmp_path, "mine.eds", find_eds("skin-patch").read_text())
    assert profile.look_up(load_eds(path, 1), profile.TOUCH_PA).default == 1000
    before = path.stat()
    path.write_text(path.read_text().replace("DefaultValue=1000", "DefaultValue=1234"))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns + 10**9))  # some file systems count in seconds
    assert profile.look_up(load_eds(path, 1), profile.TOUCH_PA).default == 1234


SPELLINGS = [
    # DataType, text, value on node 5
    (0x07, "$NODEID+0x180", 0x185),
    (0x07, "0x180+$NODEID", 0x185),
    (0x07, "$nodeid + 384", 0x185),
    (0x07, "$NODEID", 5),
    (0x06, "010", 8),
    (0x06, "0X1f", 31),
    (0x06, "42 ; the answer", 42),
    (0x03, "0xFFFB", -5),
    (0x03, "-5", -5),
    (0x10, "0xFFFFFF", -1),
    (0x15, "-9223372036854775808", -(2**63)),
    (0x1B, "0xFFFFFFFFFFFFFFFF", 2**64 - 1),
    (0x08, "0x3F800000", 1.0),
    (0x08, "1.5", 1.5),
    (0x11, "0x3FF0000000000000", 1.0),
    (0x01, "1", 1),
    (0x09, "a; b", "a; b"),
    (0x0A, "01 02ff", b"\x01\x02\xff"),
    (0x0F, "", None),
]


@pytest.mark.parametrize(("data_type", "text", "value"), SPELLINGS)
def test_every_spelling_of_cia_306_is_read(data_type, text, value):
    section = f"[2000]\nParameterName=X\nDataType={data_type}\nAccessType=rw\nDefaultValue={text}\n"
    file = read_text(section, name="x.eds")
    assert file.faults == []
    assert build_od(file, 5)[0x2000].default == value


def test_compact_array_has_names_and_values_of_its_own():
    text = """
[2000]
ParameterName=Things
ObjectType=0x8
DataType=0x0006
AccessType=rw
DefaultValue=7
PDOMapping=1
CompactSubObj=4
[2000Name]
NrOfEntries=1
3=Third
[2000Value]
NrOfEntries=2
1=0x10
4=$NODEID+1
"""
    file = read_text(text, name="x.dcf")
    assert file.faults == []
    array = build_od(file, 5)[0x2000]
    assert array[0].default == 4
    assert [profile.current(array[k]) for k in (1, 2, 3, 4)] == [16, 7, 7, 6]
    assert array["Third"].subindex == 3
    assert all(array[k].pdo_mappable for k in (1, 2, 3, 4))


def test_latin_1_and_byte_order_marks_are_read(tmp_path):
    section = "[2000]\nParameterName=Größe\nDataType=0x05\nAccessType=rw\n"
    for encoding in ("cp1252", "utf-8", "utf-8-sig"):
        path = tmp_path / f"{encoding}.eds"
        path.write_bytes(section.encode(encoding))
        assert read_eds(path).objects[0x2000].name == "Größe"
