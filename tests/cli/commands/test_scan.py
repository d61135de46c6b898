"""`skinbus scan` as a process, and what it makes of EDS files."""

import json

import pytest

from skinbus.cli.commands.scan import candidates_of, match_text, state_text
from skinbus.master.commissioning.scan import Found, Match
from skinbus.objects.cia import NmtState
from skinbus.objects.eds import eds_names, find_eds
from tests.cli.patience import PATIENCE_S, until_in_time


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


@pytest.mark.slow
def test_simulated_patch_is_listed_with_its_eds(skinbus, group, tmp_path):
    bus = ("--interface", "udp_multicast", "--channel", group)
    sim = skinbus("sim", "pad", *bus)
    assert sim.stdout.readline()
    file = tmp_path / "nodes.json"

    def scanned():
        scan = skinbus("scan", *bus, "--json", str(file))
        out, err = scan.communicate(timeout=PATIENCE_S)
        assert scan.returncode == 0, err
        return out, json.loads(file.read_text())["nodes"]

    out, (row,) = until_in_time(scanned, lambda r: r[1] and r[1][0]["state"] and r[1][0]["eds"])
    assert (row["node_id"], row["state"], row["eds"], row["eds_exact"]) == (
        1,
        "PRE_OPERATIONAL",
        ["skin-patch"],
        True,
    )
    assert "skin-patch" in out


@pytest.mark.slow
def test_empty_bus_is_status_1_with_a_hint(skinbus, group):
    scan = skinbus("scan", "--interface", "udp_multicast", "--channel", group)
    out, err = scan.communicate(timeout=PATIENCE_S)
    assert scan.returncode == 1, err
    assert "terminated" in out
