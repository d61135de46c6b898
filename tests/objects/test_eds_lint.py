"""EDS lint: our files are clean under it and under dcfchk; every planted fault is named and refused."""

import re
from pathlib import Path

import pytest

from skinbus.errors import EdsError
from skinbus.objects.eds import eds_names, find_eds, load_eds, read_eds
from skinbus.objects.eds_file import read_text
from skinbus.objects.eds_lint import lint
from skinbus.objects.pdo import tpdos
from tests.files import put
from tests.lely import assert_clean

DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize("name", eds_names())
def test_our_file_has_no_fault(name):
    assert lint(read_eds(name)) == []


@pytest.mark.parametrize("name", eds_names())
def test_our_file_is_clean_under_dcfchk(name, tmp_path):
    assert_clean(name, tmp_path)


SOURCE = find_eds("skin-patch").read_text()
END = SOURCE.rstrip().count("\n") + 3
"""Line of what is added."""


def planted():
    """Name, changes (``[section] key=value``, - to take away, + to add, s to replace) and faults of each."""
    for text in (DATA / "planted.txt").read_text().split("\n# ")[1:]:
        name, *lines = text.strip().split("\n")
        faults = [line[2:].replace("line END", f"line {END}") for line in lines if line[0] == "!"]
        yield name, ([line for line in lines if line[0] != "!"], faults)


PLANTED = dict(planted())


def changed(text, changes):
    """The text of an EDS with these changes."""
    added = [change[2:] for change in changes if change[0] == "+"]
    for change in changes:
        first, _, rest = change.partition(" ")
        if first == "-":
            text = re.sub(re.escape(rest).replace(r"\*", "[^]]*") + r"[^\[]*", "", text)
        elif first == "s":
            text = text.replace(*rest.replace("\\n", "\n").split(" => "))
        elif first != "+":
            key, is_set, _ = rest.partition("=")
            head, body, tail = re.fullmatch(rf"(?s)(.*{re.escape(first)}\n)(.*?)(\n\n.*)", text).groups()
            kept = [line for line in body.split("\n") if not line.startswith(f"{key}=")]
            text = head + "\n".join([*kept, rest] if is_set else kept) + tail
    return text if not added else "\n".join([text.rstrip(), "", *added, ""])


@pytest.mark.parametrize("name", PLANTED)
def test_planted_fault_is_refused_with_section_key_seen_and_wanted(name, tmp_path):
    changes, wanted = PLANTED[name]
    path = put(tmp_path, "planted.eds", changed(SOURCE, changes))
    with pytest.raises(EdsError) as caught:
        load_eds(path, 1)
    assert caught.value.file == str(path)
    said = [str(fault) for fault in caught.value.faults]
    for line in wanted:
        assert any(s.startswith(line) for s in said), (line, said)
    assert len(said) == len(wanted), said


def test_all_faults_of_a_file_are_said_at_once():
    independent = (
        *("restricted COB-ID", "reserved transmission type", "missing AccessType", "misspelt section"),
        "more than 64 bits mapped",
    )
    changes, wanted = ([line for name in independent for line in PLANTED[name][k]] for k in (0, 1))
    said = [str(fault) for fault in lint(read_text(changed(SOURCE, changes), name="x.eds"))]
    assert all(any(s.startswith(line) for s in said) for line in wanted), said
    assert len(said) == len(wanted)


@pytest.mark.parametrize("text", ["", "[", "[]", "=", "x=1", "[1000]", "[1800]\nObjectType=9", "[1A00sub0]"])
def test_scraps_of_a_file_give_faults_not_exceptions(text):
    assert lint(read_text(text, name="x.eds"))


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
