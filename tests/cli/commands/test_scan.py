"""`skinbus scan` on a bus, and what it makes of EDS files."""

import json

from skinbus.cli.commands.scan import candidates_of, match_text, state_text
from skinbus.master.commissioning.scan import Found, Match
from skinbus.objects.cia import NmtState
from skinbus.objects.eds import eds_names, find_eds
from skinbus.sim import World, load_scene


def test_faulty_eds_of_somebody_else_is_a_candidate_too(tmp_path):
    text = find_eds("skin-patch").read_text().replace("0x00005001", "0x00007777")
    (tmp_path / "theirs.EDS").write_text(text.replace("AccessType=ro", "AccessType=maybe", 1))
    (tmp_path / "notes.txt").write_text("not an EDS")
    candidates = list(candidates_of(tmp_path))
    assert [c.name for c in candidates] == [*eds_names(), "theirs.EDS"]
    assert candidates[-1].identity.product == 0x7777


def test_what_people_read():
    assert state_text(Found(1, NmtState.PRE_OPERATIONAL, True)) == "pre-operational"
    assert state_text(Found(1, NmtState.STOPPED)) == "stopped, no SDO"
    assert state_text(Found(1, None, True, error_register=0x11)) == "no heartbeat, error 0x11"
    assert match_text(Match(("a", "b"), True)) == "a or b"
    assert match_text(Match(("a",), False)) == "a (other revision)"
    assert match_text(Match((), False)) == "none"


def test_simulated_patch_is_listed_with_its_eds(own_bus, tmp_path):
    file = tmp_path / "nodes.json"
    with own_bus.with_cores(World(load_scene("pad"))):
        answer = own_bus.run("scan", "--json", file)
    assert answer.exit_code == 0, answer.output
    (row,) = json.loads(file.read_text())["nodes"]
    assert (row["node_id"], row["eds"], row["eds_exact"]) == (1, ["skin-patch"], True)
    assert row["state"] == "PRE_OPERATIONAL"
    assert "skin-patch" in answer.output


def test_empty_bus_is_status_1_with_a_hint(own_bus):
    answer = own_bus.run("scan")
    assert (answer.exit_code, "terminated" in answer.output) == (1, True)
