"""EDS lint: our files are clean under it and under dcfchk; every planted fault is named and refused."""

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbus.errors import EdsError
from skinbus.objects.eds import eds_names, find_eds, load_eds, read_eds
from skinbus.objects.eds_file import read_text
from skinbus.objects.eds_lint import lint
from skinbus.objects.pdo import tpdos
from tests.lely import dcfchk

DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize("name", eds_names())
def test_our_file_has_no_fault(name):
    assert lint(read_eds(name)) == []


@pytest.mark.parametrize("name", eds_names())
def test_our_file_is_clean_under_dcfchk(name, tmp_path):
    run = dcfchk(name, tmp_path)
    assert (run.returncode, run.stderr) == (0, "")


def edit(text, section, **changes):
    """Return the text with keys of a section changed, added or (None) taken away."""
    head, mark, rest = text.partition(f"[{section}]\n")
    assert mark, f"no section {section}"
    body, gap, tail = rest.partition("\n\n")
    for key, value in changes.items():
        line = re.compile(rf"^{key}=.*\n?", re.MULTILINE)
        new = "" if value is None else f"{key}={value}\n"
        body += "\n"
        body = line.sub(new, body) if line.search(body) else body + new
        body = body.rstrip("\n")
    return head + mark + body + gap + tail


def drop(text, section):
    """Return the text without a section."""
    head, mark, rest = text.partition(f"[{section}]\n")
    assert mark, f"no section {section}"
    return head + rest.partition("\n\n")[2]


def add(text, section):
    """Return the text with another section at its end."""
    return f"{text.rstrip()}\n\n{section}\n"


def mapped(text, value, sub=1):
    return edit(text, f"1A00sub{sub}", DefaultValue=value)


TEXT = find_eds("skin-patch").read_text()
END = TEXT.rstrip().count("\n") + 3
"""Line of what ``add`` adds."""


VARIABLE = "[{}]\nParameterName=Thing\nObjectType=0x7\nDataType=0x0005\nAccessType=ro"

# name: (change of skin-patch.eds, every fault it must give and no other)
PLANTED = {
    # --- the twenty of dcfchk's blind spots and beyond
    "duplicate COB-ID of two TPDOs": (
        lambda t: edit(t, "1801sub1", DefaultValue="$NODEID+0x40000180"),
        ["[1801sub1] DefaultValue: is '$NODEID+0x180'; wanted another: [1800sub1] has $NODEID+0x180"],
    ),
    "COB-ID that meets another's on one node": (
        lambda t: edit(t, "1801sub1", DefaultValue="0x00000187"),
        ["[1801sub1] DefaultValue: is '0x187'; wanted another: [1800sub1] has $NODEID+0x180 on node 7"],
    ),
    "restricted COB-ID": (
        lambda t: edit(t, "1801sub1", DefaultValue="0x00000701"),
        ["[1801sub1] DefaultValue: is '0x701'; wanted an identifier outside 0x701-0x7FF"],
    ),
    "mapping of an object that cannot be mapped": (
        lambda t: mapped(t, "0x20120110"),
        ["[1A00sub1] DefaultValue: is '0x20120110'; wanted an object with PDOMapping=1, not [2012sub1]"],
    ),
    "mapping of an object that does not exist": (
        lambda t: mapped(t, "0x64020110"),
        ["[1A00sub1] DefaultValue: is '0x64020110'; wanted an object that exists, not 0x6402:01"],
    ),
    "mapping of a sub-index that does not exist": (
        lambda t: mapped(t, "0x64011110"),
        ["[1A00sub1] DefaultValue: is '0x64011110'; wanted an object that exists, not 0x6401:11"],
    ),
    "mapped length too small": (
        lambda t: mapped(t, "0x64010108"),
        ["[1A00sub1] DefaultValue: is '0x64010108'; wanted 16 bits (0x10), the length of [6401sub1]"],
    ),
    "more than 64 bits mapped": (
        lambda t: mapped(edit(t, "1A00sub0", DefaultValue=5), "0x64010510", sub=5),
        ["[1A00]: is '80 bits mapped in all'; wanted at most 64"],
    ),
    "mapping counts more entries than there are": (
        lambda t: edit(t, "1A00sub0", DefaultValue=9, HighLimit=64),
        ["[1A00sub0] DefaultValue: is 9; wanted at most 8 mapped objects"]
        + [f"[1A00sub{k}] DefaultValue: is '0x00000000'; wanted an object, or" for k in (5, 6, 7, 8)],
    ),
    "mapping of a write-only object to a TPDO": (
        lambda t: mapped(t, "0x20500020"),
        [
            "[1A00sub1] DefaultValue: is '0x20500020'; wanted an object to read; [2050] is wo",
            "[1A00]: is '80 bits",
        ],
    ),
    "mapping of a read-only object to an RPDO": (
        lambda t: edit(t, "1600sub1", DefaultValue="0x64010110"),
        ["[1600sub1] DefaultValue: is '0x64010110'; wanted an object to write; [6401sub1] is ro"],
    ),
    "mapping of a dummy that is not in use": (
        lambda t: mapped(edit(t, "DummyUsage", Dummy0006=0), "0x00060010"),
        ["[1A00sub1] DefaultValue: is '0x00060010'; wanted Dummy0006=1 in [DummyUsage], or an object"],
    ),
    "mandatory object missing": (
        lambda t: drop(t, "1001"),
        ["[1001]: wanted this object: CiA 301 makes it mandatory"],
    ),
    "reserved transmission type": (
        lambda t: edit(t, "1800sub2", DefaultValue=241),
        ["[1800sub2] DefaultValue: is 241; wanted 0 to 240, or 252 to 255; the rest is reserved"],
    ),
    "transmission type that an RPDO cannot have": (
        lambda t: edit(t, "1400sub2", DefaultValue=253),
        ["[1400sub2] DefaultValue: is 253; wanted 0 to 240, or 254 or 255; the rest is reserved"],
    ),
    "communication parameter without mapping": (
        lambda t: re.sub(r"\[1A03[^\[]*", "", t),
        [
            "[1803]: wanted a mapping parameter [1A03] beside it",
        ],
    ),
    "mapping without communication parameter": (
        lambda t: re.sub(r"\[1803[^\[]*", "", t),
        [
            "[1A03]: wanted a communication parameter [1803] beside it",
        ],
    ),
    # --- numbers and keys
    "missing AccessType": (
        lambda t: edit(t, "1017", AccessType=None),
        ["[1017] AccessType: wanted one of ro, wo, rw, rwr, rww, const"],
    ),
    "unknown DataType": (
        lambda t: edit(t, "2040", DataType="0x0040"),
        ["[2040] DataType: is '0x0040'; wanted a data type of CiA 301, such as 0x0005"],
    ),
    "missing ParameterName": (
        lambda t: edit(t, "1017", ParameterName=None),
        ["[1017] ParameterName: wanted a name"],
    ),
    "malformed number": (
        lambda t: edit(t, "1017", DefaultValue="500ms"),
        ["[1017] DefaultValue: is '500ms'; wanted UNSIGNED16: 10, 0x0A or 012, or $NODEID+number"],
    ),
    "digits that are not octal": (
        lambda t: edit(t, "1017", DefaultValue="0800"),
        ["[1017] DefaultValue: is '0800'; wanted UNSIGNED16: 10, 0x0A or 012, or $NODEID+number"],
    ),
    "node-ID in a form that CiA 306 does not know": (
        lambda t: edit(t, "1014", DefaultValue="2*$NODEID"),
        ["[1014] DefaultValue: is '2*$NODEID'; wanted $NODEID or $NODEID+number"],
    ),
    "node-ID taken away": (
        lambda t: edit(t, "1014", DefaultValue="$NODEID-1"),
        ["[1014] DefaultValue: is '$NODEID-1'; wanted $NODEID or $NODEID+number"],
    ),
    "default above the high limit": (
        lambda t: edit(t, "1019", DefaultValue=241),
        ["[1019] DefaultValue: is 241; wanted at most 240, the high limit"],
    ),
    "default below the low limit": (
        lambda t: edit(t, "2012sub1", LowLimit=10),
        ["[2012sub1] DefaultValue: is 0; wanted at least 10, the low limit"],
    ),
    "limits the wrong way round": (
        lambda t: edit(t, "1019", LowLimit=250),
        ["[1019] LowLimit: is 250; wanted at most 240, the high limit"],
    ),
    "REAL32 that is no number": (
        lambda t: edit(t, "2030sub3", DefaultValue="0x7FC00000"),
        ["[2030sub3] DefaultValue: is '0x7FC00000'; wanted a finite number"],
    ),
    "PDOMapping that is neither 0 nor 1": (
        lambda t: edit(t, "2040", PDOMapping="yes"),
        ["[2040] PDOMapping: is 'yes'; wanted 0 or 1"],
    ),
    "misspelt key": (
        lambda t: edit(t, "1017", DefaultValue=None, DefualtValue=500),
        ["[1017] DefualtValue: is '500'; wanted the key DefaultValue"],
    ),
    "misspelt section": (
        lambda t: t.replace("[2030sub2]", "[2030sud2]"),
        [
            "[2030sud2]: wanted a section such as [1A00], [1A00sub1] or [1A00Name]",
        ],
    ),
    "section twice": (
        lambda t: add(t, "[1017]\nParameterName=Again"),
        [f"[1017]: is 'again on line {END}'; wanted each section once"],
    ),
    "key twice": (
        lambda t: t.replace("[1017]\n", "[1017]\nDataType=0x0006\n"),
        ["[1017] DataType: is '0x0006'; wanted each key once in a section"],
    ),
    "line that is neither section nor key": (
        lambda t: add(t, "Here be dragons"),
        [f"line {END}: wanted [section] or key=value"],
    ),
    "sub-object without its object": (
        lambda t: add(t, VARIABLE.format("2061sub1")),
        ["[2061sub1]: wanted a section [2061] with ObjectType 0x8 or 0x9 for it"],
    ),
    "compact array with sub-objects": (
        lambda t: edit(t, "2012", CompactSubObj=16, DataType="0x0003", AccessType="rw"),
        [f"[2012sub{k:X}]: wanted no section of its own: [2012] is compact" for k in range(10)],
    ),
}


@pytest.mark.parametrize("name", PLANTED)
def test_planted_fault_is_refused_with_section_key_seen_and_wanted(name, tmp_path):
    change, wanted = PLANTED[name]
    path = tmp_path / "planted.eds"
    path.write_text(change(find_eds("skin-patch").read_text()))
    with pytest.raises(EdsError) as caught:
        load_eds(path, 1)
    assert caught.value.file == str(path)
    said = [str(fault) for fault in caught.value.faults]
    for line in wanted:
        assert any(s.startswith(line) for s in said), (line, said)
    assert len(said) == len(wanted), said


def test_all_faults_of_a_file_are_said_at_once():
    independent = [
        "restricted COB-ID",
        "reserved transmission type",
        "missing AccessType",
        "misspelt section",
        "more than 64 bits mapped",
    ]
    text = find_eds("skin-patch").read_text()
    wanted = []
    for name in independent:
        change, lines = PLANTED[name]
        text = change(text)
        wanted += lines
    said = [str(fault) for fault in lint(read_text(text, name="x.eds"))]
    assert all(any(s.startswith(line) for s in said) for line in wanted), said
    assert len(said) == len(wanted)


@pytest.mark.parametrize("text", ["", "[", "[]", "=", "x=1", "[1000]", "[1800]\nObjectType=9", "[1A00sub0]"])
def test_scraps_of_a_file_give_faults_not_exceptions(text):
    assert lint(read_text(text, name="x.eds"))


LINES = find_eds("skin-patch-8bit").read_text().splitlines()


@pytest.mark.slow
@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(
            st.integers(0, len(LINES) - 1),
            st.one_of(st.just(""), st.sampled_from(LINES), st.text(max_size=20)),
        ),
        max_size=20,
    )
)
def test_no_text_makes_the_reader_or_the_lint_raise(changes):
    lines = list(LINES)
    for where, line in changes:
        lines[where] = line
    for fault in lint(read_text("\n".join(lines), name="x.eds")):
        assert str(fault)


def test_odd_but_legal_file_of_another_maker_is_read_without_a_fault():
    od = load_eds(DATA / "third-party.eds", 5)
    assert od[0x1008].default == "Gerät; 4 Kanäle"
    assert od[0x1014].default == 0x85
    assert od[0x1017].default == 0o12
    assert od[0x1800][1].default == 0x185
    assert od[0x2000].access_type == "rw"
    assert [od[0x2001][k].default for k in range(4)] == [3, -5, -5, -5]
    assert od[0x2001]["Third"].subindex == 3
    assert od[0x2002].default == 1.5
    assert [entry.sub for entry in tpdos(od)[0].entries] == [1, 2, 0]
