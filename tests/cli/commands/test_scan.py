"""`skinbus scan` on a bus, and what it makes of EDS files."""

from skinbus.cli.commands.scan import candidates_of
from skinbus.objects.eds import eds_names, find_eds
from skinbus.sim import World, load_scene
from tests.files import put


def test_faulty_eds_of_somebody_else_is_a_candidate_too(tmp_path):
    text = find_eds("skin-patch").read_text().replace("0x00005001", "0x00007777")
    put(tmp_path, "theirs.EDS", text.replace("AccessType=ro", "AccessType=maybe", 1))
    put(tmp_path, "notes.txt", "not an EDS")
    candidates = list(candidates_of(tmp_path))
    assert [c.name for c in candidates] == [*eds_names(), "theirs.EDS"]
    assert candidates[-1].identity.product == 0x7777


def test_simulated_patch_is_listed_with_its_eds(own_bus):
    with own_bus.with_cores(World(load_scene("pad"))):
        answer = own_bus.run("scan")
    (row,) = [line.split() for line in answer.splitlines() if line.startswith("   1 ")]
    assert (row[1], row[4]) == ("pre-operational", "skin-patch")


def test_empty_bus_is_status_1_with_a_hint(own_bus):
    assert "terminated" in own_bus.run("scan", status=1)
