"""`skinbus check-patch` as a process, against a simulated board on another."""

import json

from tests.cli.patience import PATIENCE_S


def test_simulated_board_passes_and_a_node_that_is_not_there_is_said(skinbus, group, tmp_path):
    bus = ("--interface", "udp_multicast", "--channel", group)
    sim = skinbus("sim", "pad", *bus)
    assert sim.stdout.readline()
    file = tmp_path / "rules.json"
    # two loaded processes in Python are no firmware: what is asked of their timing is little
    check = skinbus("check-patch", *bus, "--node", "1", "--response-ms", "200", "--json", str(file))
    out, err = check.communicate(timeout=PATIENCE_S)
    rows = {row["rule"]: row for row in json.loads(file.read_text())["rules"]}
    assert rows["storage"]["grade"] == "skipped"
    slow = {"heartbeat", "readings"}  # these fail when the machine is too busy for them
    assert {name for name, row in rows.items() if row["grade"] == "fail"} <= slow, (out, err)
    assert "pass    identity" in out
    absent = skinbus("check-patch", *bus, "--node", "77")
    out, err = absent.communicate(timeout=PATIENCE_S)
    assert (absent.returncode, "no node 77" in out) == (1, True), err
